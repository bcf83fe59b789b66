# SPDX-License-Identifier: GPL-3.0-or-later
# A library of ready PG boxes, and our table of them beside the paper's. Each box is made once and kept by its settings
# (pipelines/pgbox-cache, in TALUS_CACHE or results/boxes), so that a second run only prints.
#   LEVELS   of 1 (152,799 grains) to 4 (210)     SEEDS   of levels 2 to 4; level 1 is made from the first
#   ROUTES   sediment compress                    JOBS    threads
LEVELS ?= 1 2 3 4
SEEDS  ?= 1 2 3 4 5
ROUTES ?= sediment compress

.PHONY: table2
table2: build-tools
	pipelines/table2 --bin $(bin) --out results/table2 --levels "$(LEVELS)" --seeds "$(SEEDS)" --routes "$(ROUTES)" \
	    --jobs $(JOBS)

# What the settings of the sediment route do to the box and to the run time.
#   PACKING   options of pipelines/bench/packing, as PACKING="--levels 3 --seeds 1,2"
PACKING ?=

.PHONY: bench-packing
bench-packing: build-tools
	pipelines/bench/packing --bin $(bin) --out results/bench-packing --jobs $(JOBS) $(PACKING)
