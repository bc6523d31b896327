# Everything a person or CI does here. `make demo` and `make test` need only Python 3.11+ and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Every file that is installed is one whose hash stands in requirements/; what is built is built with what is there.
PIP := PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install --quiet --no-build-isolation
LOCKED := $(PIP) --require-hashes
EDITABLE := PYTHONWARNINGS=ignore $(PIP) --no-deps --editable . # setuptools warns of every editable installation

# The tests start Python some hundred times; without byte code each start compiles everything again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test lint format recordings bench bench-quick docs fuzz mutation lock audit dist clean
.DEFAULT_GOAL := demo

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "rotdrift needs Python 3.11 or newer; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.build: requirements/build.txt | $(BIN)/python
	@echo "Setting up $(VENV) (once) ..."
	@$(LOCKED) -r $<
	@touch $@

$(VENV)/.run: requirements/run.txt pyproject.toml $(VENV)/.build
	@$(LOCKED) -r $<
	@$(EDITABLE)
	@touch $@

$(VENV)/.dev: requirements/dev.txt requirements/run.txt pyproject.toml $(VENV)/.build
	@$(LOCKED) -r $<
	@$(EDITABLE)
	@touch $@ $(VENV)/.run

$(VENV)/.docs $(VENV)/.bench $(VENV)/.release: $(VENV)/.%: requirements/%.txt $(VENV)/.build
	@$(LOCKED) -r $<
	@touch $@

demo: $(VENV)/.run
	$(BIN)/rotdrift demo

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist worksteal

# The checkers of the C library are 160 MB; where they cannot be had, the compilers check alone.
lint: $(VENV)/.dev
	-@$(LOCKED) -r requirements/c.txt
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
# Then odd packets, frames, records and files with right checksums, all the way to the result. INPUTS=100000 make fuzz
RUNS ?= 20000
INPUTS ?= 1000
fuzz: $(VENV)/.dev
	-@$(LOCKED) -r requirements/fuzz.txt
	$(BIN)/python -m tests.fuzz --runs $(RUNS)
	for target in stream can recording cards scenario series bag parquet can_log; do \
	  $(BIN)/python -m tests.fuzz $$target --atheris --runs $(RUNS) || exit 1; done
	$(BIN)/python -m tests.c_library.fuzz --runs $(RUNS)
	$(BIN)/python -m tests.fuzz.result --inputs $(INPUTS)

# The program changed in one place at a time: a test must notice, or tests/mutation/explained.toml have a reason.
MINUTES ?= 60
mutation: $(VENV)/.dev
	@$(LOCKED) -r requirements/mutation.txt
	$(BIN)/python -m tests.mutation --minutes $(MINUTES)

# Versions and hashes of all that is installed. New versions: make lock UPGRADE=1
lock: $(VENV)/.release
	$(BIN)/python -m release.lock $(if $(UPGRADE),--upgrade)

# Known vulnerabilities of what is installed to run; the database is asked over the network. Without --strict, packages
# that it could not be asked about would pass as sound.
audit: $(VENV)/.release
	$(BIN)/pip-audit --requirement requirements/run.txt --require-hashes --disable-pip --strict

# Wheel, sdist, what is in them (CycloneDX), and their hashes; the same commit gives the same bytes.
dist: $(VENV)/.run $(VENV)/.release
	rm -rf dist build
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(BIN)/python -m build --no-isolation
	$(BIN)/cyclonedx-py requirements requirements/run.txt --pyproject pyproject.toml --output-reproducible \
	  --output-file dist/rotdrift.cdx.json
	cd dist && sha256sum * > SHA256SUMS

clean:
	rm -rf $(VENV) build *.egg-info
