# `make compare` runs the main job on the paper's example, `make test` the tests, `make bench` the benchmarks;
# all make what they need.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: compare test bench install clean

compare: $(VENV)/installed
	$(BIN)/sixsps compare --output report
	@echo "The report is $(CURDIR)/report/report.md"

test: $(VENV)/tested
	$(BIN)/python -m pytest -n auto

# Engines are those that are installed; ENGINES=drake,dart adds extras, QUICK=1 only shows that all works,
# BENCH holds further options.
comma := ,
bench: $(VENV)/tested
	$(PIP) install --constraint constraints.txt --editable '.[dev$(addprefix $(comma),$(ENGINES))]'
	$(BIN)/python -m benchmarks --output bench $(if $(QUICK),--quick) $(BENCH)

install: $(VENV)/installed

# Debian splits venv from Python; where this is root and it is missing, it is installed.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed, $(PYTHON) is older: make PYTHON=/path/to/python3" >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { test "$$(id -u)" = 0 && apt-get update -qq && apt-get install -y -qq python3-venv; } || \
	  { echo "Python's venv module is missing: sudo apt-get install python3-venv" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing into $(VENV)"
	$(PIP) install --constraint constraints.txt --editable '.[figures]'
	@touch $@

$(VENV)/tested: pyproject.toml constraints.txt $(VENV)/installed
	$(PIP) install --constraint constraints.txt --editable '.[dev]'
	@touch $@

clean:
	rm -rf $(VENV) dist report bench
