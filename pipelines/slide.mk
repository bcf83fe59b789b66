# SPDX-License-Identifier: GPL-3.0-or-later
# From settings to pictures of a slide. Parameters are in the file names, so changing one makes a new file and keeps
# the old; every target is complete or absent, so a second run does nothing.
#   TERRAIN  st-helens: the slide of December 2021; paper: a slope of the paper's size (pipelines/paper-slope)
#   R      largest grain radius, m            SEED   of the PG box
#   SHIFT  depth of the lower boundary below both surfaces, m
#   JOBS   threads of each tool                RANKS  of MPI for dem-run, among which its threads are shared out
#   MAX_WALL  as 3h50m: dem-run then stops with a checkpoint and make with an error; `make` again goes on
# `slide-sweep R="8 4 2"` runs several sizes one after the other and tabulates them (pipelines/slide-sweep).
TERRAIN  ?= st-helens
R        ?= 1
SEED     ?= 1
JOBS     ?= $(shell nproc)
RANKS    ?= 1
MAX_WALL ?=

one_R   := $(firstword $(R))
out     := results/$(TERRAIN)
box     := results/boxes/uniform0.82_r0.03_psi0.64_seed$(SEED)
slope   := $(out)/slope_R$(one_R)$(if $(SHIFT),_shift$(SHIFT))_seed$(SEED)
slide   := $(out)/slide_R$(one_R)$(if $(SHIFT),_shift$(SHIFT))_seed$(SEED)
share    = $(shell n=$$(($(JOBS) / $(RANKS))); echo $$((n > 1 ? n : 1)))

ifeq ($(TERRAIN),st-helens)
terrain := data-samples/st-helens-2021
scene   := pipelines/scenes/slide.json
ground  := $(wildcard $(terrain)/*)
cut      = --pre $(terrain)/pre_runout_DEM.asc --post $(terrain)/post_runout_DEM.asc --shift $(or $(SHIFT),6) \
    --source-area $(terrain)/source_area.geojson --domain $(terrain)/corridor.geojson --fixed-thickness 3.5m
beside   = --pre $(terrain)/pre_runout_DEM.asc --observed-difference $(terrain)/DEM_of_Difference.asc
else ifeq ($(TERRAIN),paper)
# 7.5 m below both surfaces gives 8 million grains at R=0.5 and 1 million at R=1. Coarse grains need room for the layer of fixed
# ones, 2.5 R across it or 3.4 R upright; much more, and the ground below the source slides as well. Cells: 10 m, 4 R at least.
terrain := $(out)/terrain
scene   := pipelines/scenes/paper-slide.json
ground  := $(terrain)/slope.json
cut      = --pre $(terrain)/pre.asc --post $(terrain)/post.asc --source-area $(terrain)/source_area.geojson \
    --domain $(terrain)/domain.geojson --shift $(or $(SHIFT),$(shell awk 'BEGIN { s = 4 * $(one_R); print (s > 7.5 ? s : 7.5) }'))
beside   = --pre $(terrain)/pre.asc --cell $(shell awk 'BEGIN { c = 4 * $(one_R); print (c > 10 ? c : 10) }')m
else
$(error TERRAIN: found $(TERRAIN), expected st-helens or paper)
endif

.PHONY: slide slide-prefix
slide-prefix: # of the slide's files, for scripts
	@echo $(slide)

slide: $(box).stats.json $(box).stats.svg $(slide).json

$(box).pgbox.h5: | $(bin)/pgbox-gen results/boxes
	pipelines/pgbox-cache $(bin)/pgbox-gen --box-length 1 --radius 0.03 --radius-min-ratio 0.82 --friction 0 \
	    --solid-volume-fraction 0.64 --route compress --seed $(SEED) -j $(JOBS) -o $@ --overwrite

$(box).stats.json $(box).stats.svg &: $(box).pgbox.h5 | $(bin)/pgbox-stats
	$(bin)/pgbox-stats $< --plot $(box).stats.svg --overwrite --format json -o $(box).stats.json

$(out)/terrain/slope.json: pipelines/paper-slope
	pipelines/paper-slope -o $(@D) --overwrite

$(slope).model.h5: $(box).pgbox.h5 $(ground) | $(bin)/tile-trim $(out)
	$(bin)/tile-trim $< $(cut) --radius-max $(one_R) -j $(JOBS) -o $@ --overwrite

# Complete or absent by itself, and hours of work: make must not delete it because of what came after.
.PRECIOUS: $(slide).traj.h5
$(slide).traj.h5: $(slope).model.h5 $(scene) | $(bin)/dem-run
	exec pipelines/run-ranks $(RANKS) $(bin)/dem-run $< -c $(scene) -j $(share) --resume auto \
	    $(if $(MAX_WALL),--max-wall $(MAX_WALL)) -o $@ --overwrite --format json > $(slide).run.json.part
	mv $(slide).run.json.part $(slide).run.json

$(slide).json: $(slide).traj.h5 | $(bin)/runout-analyse
	$(bin)/runout-analyse $< $(beside) --rasters $(slide) --plot $(slide) --overwrite --format json -o $@

# One make for each size: file names hold it.
.PHONY: slide-sweep
slide-sweep: build-tools
	for r in $(R); do $(MAKE) -f Makefile.workflow slide R=$$r TERRAIN=$(TERRAIN) || exit; done
	pipelines/slide-sweep $(foreach r,$(R),$(out)/slide_R$(r)$(if $(SHIFT),_shift$(SHIFT))_seed$(SEED)) \
	    -o $(out)/sweep.csv --overwrite

results/boxes $(out):
	mkdir -p $@
