# SPDX-License-Identifier: GPL-3.0-or-later
# How fast dem-run is, against LAMMPS where that is installed; about half an hour, on a machine that does nothing else.
#   BENCH   options of pipelines/bench/speed, as BENCH="--only S1,S3 --repeats 3", BENCH=--quick, BENCH=--large
BENCH ?=

.PHONY: bench-speed
bench-speed: build-tools
	@command -v lmp >/dev/null || \
	    echo "LAMMPS is not installed: the columns of comparison stay empty (Debian: apt-get install lammps)"
	pipelines/bench/speed --bin $(bin) --out results/bench-speed $(BENCH)
