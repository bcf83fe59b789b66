# SPDX-License-Identifier: GPL-3.0-or-later
# Triaxial tests from PG box to cohesion and friction angle. Each test is done once and kept by its settings in
# results/table4; one that was stopped goes on with the same call.
#   RATIO     diameters of specimen and grains, D/d: 25 is some 30,000 grains, 50 some 240,000, 100 the paper's 1.9 million
#   STRESSES  confining stresses, kPa         SEEDS    of the boxes: each a repeat of every test
#   GROUPS    PL PF FF: boxes made without friction, with friction 0.4; fallen into place without boxes
#   LEVELS    of the boxes, 1 (finest) to 4    JOBS     cores in all
#   TRIAXIAL  more options of pipelines/table4, as TRIAXIAL="--set triaxial.platen_velocity=0.1"
# For `table4` SEEDS and LEVELS have defaults of their own.
RATIO    ?= 25
STRESSES ?= 0 100 200
GROUPS   ?= PL PF
TRIAXIAL ?=
given     = $(if $(filter command environment,$(firstword $(origin $(1)))),$($(1)),$(2))

.PHONY: table4
table4: build-tools
	pipelines/table4 --bin $(bin) --out results/table4 --ratios "$(RATIO)" --stresses "$(STRESSES)" \
	    --seeds "$(call given,SEEDS,1)" --groups "$(GROUPS)" --levels "$(call given,LEVELS,2)" $(if $(JOBS),--jobs $(JOBS)) $(TRIAXIAL)

# Run time against error: platen speed, time step, D/d, membrane, damping.
#   BENCH_TRIAXIAL   options of pipelines/bench/triaxial, as BENCH_TRIAXIAL="--only platen_velocity --ratio 12"
BENCH_TRIAXIAL ?=

.PHONY: bench-triaxial
bench-triaxial: build-tools
	pipelines/bench/triaxial --bin $(bin) --out results/bench-triaxial $(if $(JOBS),--jobs $(JOBS)) $(BENCH_TRIAXIAL)
