# SPDX-License-Identifier: GPL-3.0-or-later
# Run time against error of dem-run, for each of its knobs; pipelines/bench/accuracy says what is measured.
#   ACCURACY_OUT   folder of the results        JOBS   threads of dem-run       ACCURACY_OPTIONS   more, as --quick
ACCURACY_OUT     ?= results/bench-accuracy
ACCURACY_OPTIONS ?=

.PHONY: bench-accuracy
bench-accuracy: build-tools
	pipelines/bench/accuracy --bin $(bin) --out $(ACCURACY_OUT) $(if $(JOBS),--threads $(JOBS)) $(ACCURACY_OPTIONS)
