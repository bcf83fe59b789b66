# SPDX-License-Identifier: GPL-3.0-or-later
# How fast dem-run is, against LAMMPS where that is installed; about half an hour, on a machine that does nothing else.
#   BENCH   options of pipelines/bench/speed, as BENCH="--only S1,S3 --repeats 3", BENCH=--quick, BENCH=--large
BENCH ?=

.PHONY: bench-speed
bench-speed: build-tools
	@command -v lmp >/dev/null || \
	    echo "LAMMPS is not installed: the columns of comparison stay empty (Debian: apt-get install lammps)"
	pipelines/bench/speed --bin $(bin) --out results/bench-speed $(BENCH)

# Strong and weak curves over ranks, a model of the cost of a step fitted to them, and its predictions; ten minutes.
#   SCALING   options of pipelines/bench/scaling, as SCALING="--latency 1e-6 --bandwidth 1e9"
SCALING ?=

.PHONY: bench-scaling
bench-scaling: build-tools
	pipelines/bench/scaling --bin $(bin) --out results/bench-scaling $(SCALING)

# A slope of 6.5 billion grains in tiles, and the speed of expansion; some minutes.
#   TILING   options of pipelines/bench/tiling, as TILING=--quick
TILING ?=

.PHONY: bench-tiling
bench-tiling: build-tools
	pipelines/bench/tiling --bin $(bin) --out results/bench-tiling $(TILING)

# What sleep saves and what it changes: heap and slides with and without; a quarter of an hour on a machine that does nothing else.
#   SLEEP   options of pipelines/bench/sleep, as SLEEP=--quick, SLEEP="--only heap --grains 20000"
SLEEP ?=

.PHONY: bench-sleep
bench-sleep: build-tools
	pipelines/bench/sleep --bin $(bin) --out results/bench-sleep $(SLEEP)
