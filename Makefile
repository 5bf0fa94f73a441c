# `make demo` shows the suite at work, `make test` checks it. Both set themselves up in .venv/.
PYTHON ?= python3
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
# Which ROS of the Python registry: jazzy or kilted, each in an environment of its own.
ROS ?= jazzy
VENV ?= .venv/$(if $(filter-out jazzy,$(ROS)),$(ROS)-)py$(VERSION)
BIN := $(VENV)/bin
JOBS ?= 2
DEMO_BAG ?= bags/demo

.PHONY: docs docs-commands clean-install demo test check bench lab soak clean

demo: $(VENV)/run
	$(BIN)/binopos replay $(DEMO_BAG)

test: check
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m 'not live' -n $(JOBS) --dist loadgroup $(PYTEST_ARGS)
	$(BIN)/python -m pytest -m live -n $(JOBS) --dist loadfile --ignore test/camera_lab $(PYTEST_ARGS)
	$(BIN)/python -m pytest test/camera_lab $(PYTEST_ARGS)

# Format, lint and types.
check: $(VENV)/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

# Figures of speed and accuracy, each beside a peer in the same run; half an hour.
bench: $(VENV)/ready
	$(BIN)/pip install --quiet -r requirements-bench.txt
	$(BIN)/pip install --quiet --no-deps aquacal==2.1.0
	for name in optics/speed triangulation/index detection/speed smoothing/speed bag/libraries \
		simulation/rendering platform/speed platform/target calibration/peers calibration/lenses \
		calibration/doubled pipeline live view; do \
		echo "== bench/$$name.py"; $(BIN)/python bench/$$name.py || exit 1; done
	$(BIN)/python bench/pages.py

# The part of `make test` on real camera drivers, in a virtual machine; it installs QEMU.
lab: $(VENV)/ready
	$(BIN)/python -m pytest test/camera_lab $(PYTEST_ARGS)

# 200 times unplugged and plugged in again, in a virtual machine; seven minutes.
soak: $(VENV)/ready
	test/camera_lab/setup
	PYTHON=$(BIN)/python test/camera_lab/soak

# What the suite runs on: ROS, numpy, OpenCV and the readers of bags.
$(VENV)/run: requirements.txt requirements-$(ROS).txt setup.py
	@echo "setting up $(VENV): a minute, most of it ROS and OpenCV"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet -r requirements.txt -r requirements-$(ROS).txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	$(BIN)/python -m compileall -q binopos_ros
	touch $@

# What the checks need beside it.
$(VENV)/ready: $(VENV)/run requirements-test.txt
	$(BIN)/pip install --quiet -r requirements-test.txt
	touch $@

# The site in build/docs/index.html; nothing is fetched while it is built, warnings are errors.
docs: $(VENV)/docs
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo build/docs/index.html

# What the documents show, run as it stands there; minutes.
docs-commands: $(VENV)/run
	$(BIN)/python docs/commands.py

# The wheel in an environment of its own, elsewhere; minutes.
clean-install: $(VENV)/ready
	$(BIN)/python test/clean_install.py

$(VENV)/docs: $(VENV)/ready requirements-docs.txt
	$(BIN)/pip install --quiet -r requirements-docs.txt
	touch $@

clean:
	rm -rf .venv build dist install log out *.egg-info
