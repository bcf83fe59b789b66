# SPDX-License-Identifier: GPL-3.0-or-later
# From settings to pictures of the Mount St Helens slide. Parameters are in the file names, so changing one makes a
# new file and keeps the old; every target is complete or absent, so a second run does nothing.
#   R      largest grain radius, m            SEED   of the PG box
#   JOBS   threads of each tool                RANKS  of MPI for dem-run, among which its threads are shared out
#   MAX_WALL  as 3h50m: dem-run then stops with a checkpoint and make with an error; `make` again goes on
R        ?= 1
SEED     ?= 1
JOBS     ?= $(shell nproc)
RANKS    ?= 1
MAX_WALL ?=

terrain := data-samples/st-helens-2021
out     := results/st-helens
box     := results/boxes/uniform0.82_r0.03_psi0.64_seed$(SEED)
slope   := $(out)/slope_R$(R)_seed$(SEED)
slide   := $(out)/slide_R$(R)_seed$(SEED)
share    = $(shell n=$$(($(JOBS) / $(RANKS))); echo $$((n > 1 ? n : 1)))

.PHONY: slide
slide: $(box).stats.json $(box).stats.svg $(slide).json

$(box).pgbox.h5: | $(bin)/pgbox-gen results/boxes
	pipelines/pgbox-cache $(bin)/pgbox-gen --box-length 1 --radius 0.03 --radius-min-ratio 0.82 --friction 0 \
	    --solid-volume-fraction 0.64 --route compress --seed $(SEED) -j $(JOBS) -o $@ --overwrite

$(box).stats.json $(box).stats.svg &: $(box).pgbox.h5 | $(bin)/pgbox-stats
	$(bin)/pgbox-stats $< --plot $(box).stats.svg --overwrite --format json -o $(box).stats.json

$(slope).model.h5: $(box).pgbox.h5 $(wildcard $(terrain)/*) | $(bin)/tile-trim $(out)
	$(bin)/tile-trim $< --pre $(terrain)/pre_runout_DEM.asc --post $(terrain)/post_runout_DEM.asc --shift 6 \
	    --source-area $(terrain)/source_area.geojson --domain $(terrain)/corridor.geojson \
	    --fixed-thickness 3.5m --radius-max $(R) -j $(JOBS) -o $@ --overwrite

# Complete or absent by itself, and hours of work: make must not delete it because of what came after.
.PRECIOUS: $(slide).traj.h5
$(slide).traj.h5: $(slope).model.h5 pipelines/scenes/slide.json | $(bin)/dem-run
	pipelines/run-ranks $(RANKS) $(bin)/dem-run $< -c pipelines/scenes/slide.json -j $(share) --resume auto \
	    $(if $(MAX_WALL),--max-wall $(MAX_WALL)) -o $@ --overwrite

$(slide).json: $(slide).traj.h5 | $(bin)/runout-analyse
	$(bin)/runout-analyse $< --pre $(terrain)/pre_runout_DEM.asc --observed-difference $(terrain)/DEM_of_Difference.asc \
	    --rasters $(slide) --plot $(slide) --overwrite --format json -o $@

results/boxes $(out):
	mkdir -p $@
