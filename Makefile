# make demo | make test [PYTEST_ARGS=...] | make bench [BENCH_ARGS=--quick] | make fuzz [FUZZ_ARGS="--seconds 120 --seed 0"] | make docs | make bags | make setup; each does the set-up that is still missing.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:

# The first interpreter that runs and is 3.11 or 3.12 (a pyenv shim may exist and not run).
PYTHON ?= $(shell for p in python3.11 python3.12 python3; do \
  $$p -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null && { echo $$p; break; }; done)
PYTEST_ARGS ?=
BENCH_ARGS ?=
FUZZ_ARGS ?= --seconds 120 --seed 0
# Pip leaves compiling to the first import (--no-compile): not kept, every process would compile NumPy, SciPy and us anew.
export PYTHONDONTWRITEBYTECODE :=

# Two cores are used: the messages are built while the rest is installed. Each step leaves a stamp behind.
MAKEFLAGS += --jobs=2
PIP := .venv/bin/python -m pip install --quiet --no-compile --disable-pip-version-check
COLCON := env -u MAKEFLAGS colcon --log-base log build --base-paths . msg_defs --symlink-install \
  --event-handlers console_direct- --packages-select
ROS_INSTALLED := .venv/.ros-installed
INSTALLED := .venv/.installed
MESSAGES_BUILT := install/.messages-built
BUILT := install/.built

.PHONY: setup demo test bench fuzz docs bags clean

setup: $(BUILT)

$(ROS_INSTALLED): requirements/ros.txt
	@test -n "$(PYTHON)" || { echo "make: Python 3.11 or 3.12 is needed; name one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@command -v cmake >/dev/null || { echo "make: cmake and a C compiler are needed (apt-get install cmake g++)" >&2; exit 1; }
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	$(PIP) -r requirements/ros.txt -c requirements/tools.txt
	touch $@

$(INSTALLED): $(ROS_INSTALLED) requirements/runtime.txt requirements/lab.txt requirements/tools.txt
	$(PIP) -r requirements/ros.txt -r requirements/runtime.txt -r requirements/lab.txt -r requirements/tools.txt
	touch $@

$(MESSAGES_BUILT): $(ROS_INSTALLED) cmake/ros_wheels.cmake $(shell find msg_defs -type f)
	export SEMANTIC_SLAM_BUILDING=1; source ./env.sh; \
	$(COLCON) semantic_slam_msgs --cmake-args -DCMAKE_PROJECT_INCLUDE=$(CURDIR)/cmake/ros_wheels.cmake
	touch $@

$(BUILT): $(INSTALLED) $(MESSAGES_BUILT) setup.py setup.cfg package.xml lab/setup.py lab/pyproject.toml $(wildcard launch/* config/*)
	export SEMANTIC_SLAM_BUILDING=1; source ./env.sh; $(COLCON) semantic_slam
	$(PIP) --no-deps --no-build-isolation --editable ./lab
	touch $@

demo: $(BUILT)
	source ./env.sh; demo --out out/demo --overwrite

test: $(BUILT)
	source ./env.sh; python -m pytest --numprocesses=2 --dist=worksteal $(PYTEST_ARGS)

bench: $(BUILT)
	source ./env.sh; bench --out out/bench.json --overwrite $(BENCH_ARGS)

fuzz: $(BUILT)
	source ./env.sh; python -m semantic_slam_lab.fuzz $(FUZZ_ARGS)

docs: $(BUILT)
	source ./env.sh; python -m semantic_slam_lab.documentation.build; NO_MKDOCS_2_WARNING=1 mkdocs build --strict --quiet

bags: $(BUILT)
	rm -rf build/scenes; source ./env.sh; make_scene --out build/scenes --seed 0 --tour-only; \
	import_dataset avd build/scenes/Gen_000_1 --out bags/aliased_room --seed 2 --overwrite
	source ./env.sh; make_scene --standing --out bags --seed 0 --overwrite

clean:
	rm -rf build install log out lab/build
