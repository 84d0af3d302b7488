# Two commands do all the set-up on a fresh machine: `make demo` and `make test`. They need python3, pip and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO := reports/quickstart

.PHONY: setup demo test check study clean

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "maglev-offline needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: setup  ## the whole road on the bundled surrogate logs; prints where the report is
	$(BIN)/maglev-offline run pipelines/quickstart.toml --workspace $(DEMO)

test: setup  ## the tests, but for the slow studies
	$(BIN)/python -m pytest -n auto --dist loadfile

check: setup  ## what CI checks before the tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

study: setup  ## the slow learning studies
	$(BIN)/python -m pytest -m study

clean:
	rm -rf $(VENV) $(DEMO) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
