# Two commands do all the set-up on a fresh machine: `make demo` and `make test`. They need python3, pip and make.
PYTHON ?= python3
VENV ?= .venv
FOREIGN ?= .venv-exports
BIN := $(VENV)/bin
DEMO := reports/quickstart

.PHONY: setup demo test check study exports clean

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

study: setup  ## the slow learning studies; hours, and what is stopped goes on where it was
	$(BIN)/python -m pytest -m study
	for study in changsha study; do \
	  $(BIN)/maglev-offline ingest --recipe pipelines/$$study.toml --workspace reports/$$study-work data_raw/*.mcap && \
	  $(BIN)/maglev-offline transfer --recipe pipelines/$$study.toml --workspace reports/$$study-work && \
	  $(BIN)/maglev-offline report --recipe pipelines/$$study.toml --workspace reports/$$study-work || exit 1; \
	done

exports: $(FOREIGN)/.installed  ## exported prefills in the libraries that they are for: d3rlpy, Minari, TorchRL, SB3
	$(FOREIGN)/bin/python -m pytest tests/replay/exports

$(FOREIGN)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(FOREIGN)
	$(FOREIGN)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
	  --editable '.[exports,foreign]' hypothesis pytest
	@touch $@

clean:
	rm -rf $(VENV) $(FOREIGN) $(DEMO) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
