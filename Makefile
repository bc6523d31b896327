# Everything a person or CI does here. `make demo` and `make test` need only Python 3.11+ and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet

# The tests start Python some hundred times; without byte code each start compiles everything again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test lint format recordings bench bench-quick docs fuzz clean
.DEFAULT_GOAL := demo

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "rotdrift needs Python 3.11 or newer; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Setting up $(VENV) (once) ..."
	@$(PIP) --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Setting up $(VENV) for development (once) ..."
	@$(PIP) --editable '.[dev]'
	@touch $@ $(VENV)/.run

$(VENV)/.docs: pyproject.toml constraints.txt | $(BIN)/python
	@$(PIP) --editable '.[docs]'
	@touch $@

$(VENV)/.bench: pyproject.toml constraints.txt | $(BIN)/python
	@$(PIP) --editable '.[bench]'
	@touch $@

demo: $(VENV)/.run
	$(BIN)/rotdrift demo

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist worksteal

# The checkers of the C library are 160 MB; where they cannot be had, the compilers check alone.
lint: $(VENV)/.dev
	-@$(PIP) --editable '.[c]'
	$(BIN)/python -m tests.c_library.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/numpydoc lint $$(find analysis emulator firmware_protocol host -name '*.py')
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

recordings: $(VENV)/.dev
	$(BIN)/python -m benchmarks.recordings_table

bench: $(VENV)/.run $(VENV)/.bench
	$(BIN)/python -m benchmarks

bench-quick: $(VENV)/.run $(VENV)/.bench
	$(BIN)/python -m benchmarks --quick

docs: $(VENV)/.dev $(VENV)/.docs
	$(BIN)/python docs/pictures.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# Hostile input: mutated seeds for every target, then atheris (Linux) from the same seeds. RUNS=1000000 make fuzz
RUNS ?= 20000
fuzz: $(VENV)/.dev
	-@$(PIP) --editable '.[fuzz]'
	$(BIN)/python -m tests.fuzz --runs $(RUNS)
	for target in stream can recording cards scenario series bag; do \
	  $(BIN)/python -m tests.fuzz $$target --atheris --runs $(RUNS) || exit 1; done
	$(BIN)/python -m tests.c_library.fuzz --runs $(RUNS)

clean:
	rm -rf $(VENV) build *.egg-info
