# Two commands do all the set-up on a fresh machine: `make demo` and `make test`. They need python3, pip and make.
PYTHON ?= python3
VENV ?= .venv
FOREIGN ?= .venv-exports
CLUSTERS ?= .venv-clusters
BIN := $(VENV)/bin
DEMO := reports/quickstart

STUDIES := changsha study cure
FAULTS ?= 20
FUZZ ?= 20000

.PHONY: setup demo test check wheel study publish exports clusters faults fuzz nightly clean

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "maglev-offline needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt \
	  --editable '.[dev]'
	@touch $@

demo: setup  ## the whole road on the bundled surrogate logs; prints where the report is
	$(BIN)/maglev-offline run pipelines/quickstart.toml --workspace $(DEMO)

test: setup  ## the tests, but for the slow studies
	$(BIN)/python -m pytest -n auto

check: setup  ## what CI checks before the tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

wheel: setup  ## build one wheel, install it in a clean environment, and look at it from outside the tree; half a minute
	.ci/wheel

study: setup  ## the slow learning studies; hours, and what is stopped goes on where it was
	$(BIN)/python -m pytest -m study
	for study in $(STUDIES); do \
	  $(BIN)/maglev-offline ingest --recipe pipelines/$$study.toml --workspace reports/$$study-work data_raw/*.mcap && \
	  for step in control transfer report; do \
	    $(BIN)/maglev-offline $$step --recipe pipelines/$$study.toml --workspace reports/$$study-work || exit 1; \
	  done || exit 1; \
	done
	$(MAKE) publish

publish:  ## report, curves and verdicts of finished studies, from reports/NAME-work to where git keeps them
	set -e; for study in $(STUDIES); do rm -rf reports/$$study; for work in reports/$$study-work reports/$$study-work/periods/*; do \
	  if [ -d $$work/transfer ]; then \
	    home=reports/$$study$${work#reports/$$study-work}; mkdir -p $$home; \
	    cp $$work/transfer/manifest.json $$work/transfer/*.parquet $$home; \
	    if [ -f $$work/report/report.html ]; then cp $$work/report/report.html $$home; fi; \
	  fi; done; done

exports: $(FOREIGN)/.installed  ## exported prefills in the libraries that they are for: d3rlpy, Minari, TorchRL, SB3
	$(FOREIGN)/bin/python -m pytest tests/replay/exports

clusters: $(CLUSTERS)/.installed  ## two-worker clusters of Dask and Ray, and a store that speaks S3
	$(CLUSTERS)/bin/python -m pytest -m 'nightly or not nightly' tests/cluster tests/test_s3.py

faults: setup  ## commands killed, disks filled, files damaged and taken away; FAULTS of each kind and command
	FAULTS=$(FAULTS) $(BIN)/python -m pytest -n 0 -m faults tests/faults

fuzz: setup  ## FUZZ changed files of every kind that a user may be handed, from number FUZZ_FROM on
	FUZZ=$(FUZZ) $(BIN)/python -m pytest -n 0 -s -m fuzz tests/fuzz

nightly: setup exports clusters  ## benchmarks in small, exports, clusters and stores for real
	$(BIN)/python -m pytest -n auto -m nightly

$(FOREIGN)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(FOREIGN)
	$(FOREIGN)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
	  --editable '.[exports,foreign]' hypothesis pytest
	@touch $@

$(CLUSTERS)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(CLUSTERS)
	$(CLUSTERS)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
	  --editable '.[clusters]' hypothesis pytest
	@touch $@

clean:
	rm -rf $(VENV) $(FOREIGN) $(CLUSTERS) $(DEMO) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
