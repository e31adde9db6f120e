# make demo: fill a bin, look at it, empty it, record it, compare.   make test: all tests.
# Both set up what they need: a virtual environment in .venv, the package, and system OpenGL where missing.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTEST := $(BIN)/python -m pytest -n 2

.PHONY: help demo test quick fuzz mutants coverage lint docs doctor install clean
.DEFAULT_GOAL := help
help:
	@echo "make demo      run the main job: a bin of parts is filled, seen, emptied by four modes and recorded in logs/demo"
	@echo "make test      run all tests"
	@echo "make quick     run the tests that take no process, episode or training of their own: under a minute"
	@echo "make fuzz      run the tests of damaged files with 5000 examples each instead of 100"
	@echo "make mutants   change the code of the rooms that matter most, one place at a time, and list what no test notices: hours"
	@echo "make coverage  run all tests and report the lines that none of them executes"
	@echo "make lint      run ruff and pyright"
	@echo "make docs      build the documentation in site/"
	@echo "make doctor    report what is installed and what to fix"
	@echo "make clean     remove the virtual environment and caches (logs/ stays)"

$(READY): pyproject.toml .ci/constraints.txt .ci/ensure-gl
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "simpick needs Python 3.11 or newer, $(PYTHON) is $$($(PYTHON) --version 2>&1). Try: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
	  { echo "could not make a virtual environment; on Debian or Ubuntu: sudo apt-get install -y python3-venv" >&2; exit 1; }
	@echo "installing, about a minute"
	$(BIN)/python -m pip install --quiet --constraint .ci/constraints.txt --editable '.[dev]'
	.ci/ensure-gl $(BIN)/python
	@touch $@

install: $(READY)

demo: $(READY)
	@echo "picking one bin by four perception modes, about two minutes on two cores"
	$(BIN)/simpick compare oracle coarse fine refined --parts pipe_tee crane_hook l_bracket hex_nut --count 6 \
	  --episodes 1 --out logs/demo --record --overwrite

test: $(READY)
	$(PYTEST)

quick: $(READY)
	$(PYTEST) -m "not slow"

fuzz: $(READY)
	$(PYTEST) -k fuzz --hypothesis-profile=fuzz

# In a copy whose links are folders: mutmut writes its mutants beside the code, and does not follow links.
mutants: $(READY)
	@$(BIN)/python -m pip install --quiet --constraint .ci/constraints.txt --editable '.[mutants]'
	@mkdir -p build/mutants && cp -RL --update simpick tests pyproject.toml build/mutants/
	cd build/mutants && OMP_NUM_THREADS=1 $(CURDIR)/$(BIN)/mutmut run $(MUTANTS); $(CURDIR)/$(BIN)/mutmut results

coverage: $(READY)
	$(PYTEST) --cov --cov-report=term:skip-covered

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

docs: $(READY)
	$(BIN)/python -m pip install --quiet --constraint .ci/constraints.txt --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "site/index.html; with search: $(BIN)/python -m http.server -d site"

doctor: $(READY)
	$(BIN)/simpick doctor

clean:
	rm -rf $(VENV) build dist site *.egg-info .pytest_cache .ruff_cache .hypothesis .coverage
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
