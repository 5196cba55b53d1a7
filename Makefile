# Each target sets up what it needs in .venv on a machine that has Python (3.11 to 3.13) and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ACTUATOR ?= geometries/fast_tool_servo.toml
OUT ?= study
NEWEST ?= .venv-newest
WORKERS ?= 2
INPUTS ?= 20000
# Byte code is made of what is imported, where it is imported first: of all that is installed it takes as long as unpacking.
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING ?= 1
# Where it is set, each of the programs that the tests start would translate all of the project's source anew.
unexport PYTHONDONTWRITEBYTECODE

SHORT := tests/test_architecture.py tests/test_package.py tests/test_names.py tests/actuator/test_actuator.py \
  tests/files/test_quantity.py tests/files/test_toml_text.py tests/files/test_whole_file.py tests/table tests/materials \
  tests/magnetics/test_mesh.py tests/magnetics/test_published_magnets.py tests/cli/test_commands.py tests/computing \
  tests/plant/test_kernel.py tests/record/test_log_import.py tests/record/test_raw_logs.py tests/record/test_record_reader.py \
  tests/record/test_record_writer.py tests/maps/test_operating_map.py tests/export/test_fmi3.py tests/export/test_tables.py \
  tests/export/test_c_printer.py tests/export/test_dxf_magnet.py tests/export/test_other_tools.py tests/control/test_design.py \
  tests/identification/test_simulate_and_predict.py tests/identification/test_physical.py tests/report/test_page.py \
  tests/robustness/test_netcdf_file.py tests/robustness/test_text_files.py tests/robustness/test_supply.py

.PHONY: study test pytest short fuzz kills coverage newest bench lint docs clean diagnosis-study real-records
.DELETE_ON_ERROR:

study: $(VENV)/.installed
	$(BIN)/msl-fem study $(ACTUATOR) -o $(OUT)

# The type checker runs beside the tests.
test: $(VENV)/.installed-test
	$(MAKE) --no-print-directory -j 2 lint pytest

pytest: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile

# Bad files by the thousand against all that reads files, with a table of how they ended; hours.
fuzz: $(VENV)/.installed-test
	$(BIN)/python tests/robustness/fuzz.py --inputs $(INPUTS)

# Commands killed at random moments, with a table of what was left and how the next run went; an hour.
kills: $(VENV)/.installed-test
	$(BIN)/python tests/robustness/kills.py

# Which lines the tests run; compiled functions are not counted.
coverage: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --cov --cov-report=term

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# A short test of every part, as for another Python: make short PYTHON=python3.13 VENV=.venv-3.13
short: $(VENV)/.installed-test
	$(BIN)/python -m pytest $(SHORT)

# The newest versions that pyproject.toml allows, in an environment of their own, and a short test of every part.
newest:
	$(MAKE) VENV=$(NEWEST) $(NEWEST)/bin/python
	$(NEWEST)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade --upgrade-strategy eager -e '.[test]'
	$(NEWEST)/bin/python -m pip list --disable-pip-version-check --format=freeze
	$(NEWEST)/bin/python -m pytest -n $(WORKERS) --dist loadfile $(SHORT)

# The README's tables, measured anew on this machine, and those of the documents that say so; half an hour.
bench: $(VENV)/.installed-bench
	$(BIN)/python benchmarks/field.py --readme
	cd benchmarks && ../$(BIN)/python speed.py --readme
	$(BIN)/python benchmarks/guard.py --docs
	$(BIN)/python benchmarks/controller_c.py --docs

# All real sets converted, diagnosed and judged, a table in docs/real_records.md; goes on where it stopped.
real-records: $(VENV)/.installed
	cd benchmarks && ../$(BIN)/python real_sets.py --docs

docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "documentation: site/index.html"

# The pip that comes with a Python may be years old: 23.2 takes a minute to choose what 26.0 chooses in a quarter.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' \
	  || { echo "$(PYTHON) is not Python 3.11 to 3.13; name one that is: make PYTHON=python3.12" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) pip

$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) -e .
	@touch $@

# All at once: a second installation resolves and builds anew.
$(VENV)/.installed-test: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) -e '.[test]'
	@touch $(VENV)/.installed $@

$(VENV)/.installed-bench: $(VENV)/.installed-test
	$(PIP) -e '.[bench]'
	@touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(PIP) -e '.[docs]'
	@touch $@

diagnosis-study: $(VENV)/.installed # hours; goes on where it stopped
	$(BIN)/python benchmarks/diagnosis_study.py
	$(BIN)/python benchmarks/diagnosis_study.py --tables --docs

clean:
	rm -rf $(VENV) $(NEWEST) $(OUT) site build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
