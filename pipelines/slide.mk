# SPDX-License-Identifier: GPL-3.0-or-later
# From settings to pictures of the Mount St Helens slide. Parameters are in the file names, so changing one makes a
# new file and keeps the old; every target is complete or absent, so a second run does nothing.
#   R      largest grain radius, m            SEED   of the PG box
#   JOBS   threads of each tool
R    ?= 1
SEED ?= 1
JOBS ?= $(shell nproc)

terrain := data-samples/st-helens-2021
out     := results/st-helens
box     := results/boxes/uniform0.82_r0.03_psi0.64_seed$(SEED)
slope   := $(out)/slope_R$(R)_seed$(SEED)
slide   := $(out)/slide_R$(R)_seed$(SEED)

.PHONY: slide
slide: $(box).stats.json $(box).stats.svg $(slide).json

$(box).pgbox.h5: | $(bin)/pgbox-gen results/boxes
	$(bin)/pgbox-gen --box-length 1 --radius 0.03 --radius-min-ratio 0.82 --friction 0 --solid-volume-fraction 0.64 \
	    --route compress --seed $(SEED) -j $(JOBS) -o $@ --overwrite

$(box).stats.json: $(box).pgbox.h5 | $(bin)/pgbox-stats
	$(bin)/pgbox-stats $< --plot $(box).stats.svg --overwrite --format json -o $@

$(slope).model.h5: $(box).pgbox.h5 $(wildcard $(terrain)/*) | $(bin)/tile-trim $(out)
	$(bin)/tile-trim $< --pre $(terrain)/pre_runout_DEM.asc --post $(terrain)/post_runout_DEM.asc --shift 6 \
	    --source-area $(terrain)/source_area.geojson --domain $(terrain)/corridor.geojson \
	    --fixed-thickness 3.5m --radius-max $(R) -j $(JOBS) -o $@ --overwrite

$(slide).traj.h5: $(slope).model.h5 pipelines/scenes/slide.json | $(bin)/dem-run
	$(bin)/dem-run $< -c pipelines/scenes/slide.json -j $(JOBS) --resume auto -o $@ --overwrite

$(slide).json: $(slide).traj.h5 | $(bin)/runout-analyse
	$(bin)/runout-analyse $< --pre $(terrain)/pre_runout_DEM.asc --observed-difference $(terrain)/DEM_of_Difference.asc \
	    --rasters $(slide) --plot $(slide) --overwrite --format json -o $@

results/boxes $(out):
	mkdir -p $@
