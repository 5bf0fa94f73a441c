# `make demo` shows the suite at work, `make test` checks it. Both set themselves up in .venv/.
PYTHON ?= python3
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
VENV ?= .venv/py$(VERSION)
BIN := $(VENV)/bin
JOBS ?= 2
DEMO_BAG ?= bags/demo

.PHONY: demo test check bench clean

demo: $(VENV)/ready
	$(BIN)/binopos replay $(DEMO_BAG)

test: check
	$(BIN)/python -m pytest -m 'not live' -n $(JOBS) --dist loadgroup $(PYTEST_ARGS)
	$(BIN)/python -m pytest -m live $(PYTEST_ARGS)

# Format, lint and types.
check: $(VENV)/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(VENV)/ready
	$(BIN)/pip install --quiet -r requirements-bench.txt
	for script in bench/*.py; do $(BIN)/python $$script || exit 1; done

$(VENV)/ready: requirements.txt requirements-test.txt setup.py
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -r requirements-test.txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

clean:
	rm -rf .venv build dist install log out *.egg-info
