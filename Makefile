# make demo | make test [PYTEST_ARGS=...] | make bags | make setup; each does the set-up that is still missing.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:

# The first interpreter that runs and is 3.11 or 3.12 (a pyenv shim may exist and not run).
PYTHON ?= $(shell for p in python3.11 python3.12 python3; do \
  $$p -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null && { echo $$p; break; }; done)
PYTEST_ARGS ?=

REQUIREMENTS := requirements/ros.txt requirements/runtime.txt requirements/tools.txt
BUILD_INPUTS := setup.py setup.cfg package.xml cmake/ros_wheels.cmake $(wildcard launch/* config/*) \
  msg_defs/CMakeLists.txt msg_defs/package.xml $(wildcard msg_defs/msg/*.msg)
INSTALLED := .venv/.installed
BUILT := install/.built

.PHONY: setup demo test bags clean

setup: $(BUILT)

$(INSTALLED): $(REQUIREMENTS)
	@test -n "$(PYTHON)" || { echo "make: Python 3.11 or 3.12 is needed; name one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@command -v cmake >/dev/null || { echo "make: cmake and a C compiler are needed (apt-get install cmake g++)" >&2; exit 1; }
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --no-compile --disable-pip-version-check $(addprefix -r ,$(REQUIREMENTS))
	touch $@

$(BUILT): $(INSTALLED) $(BUILD_INPUTS)
	export SEMANTIC_SLAM_BUILDING=1; source ./env.sh; \
	colcon --log-base log build --base-paths . msg_defs --symlink-install --event-handlers console_direct- \
	  --cmake-args -DCMAKE_PROJECT_INCLUDE=$(CURDIR)/cmake/ros_wheels.cmake -DBUILD_TESTING=OFF
	touch $@

demo: $(BUILT)
	source ./env.sh; demo --out out/demo

test: $(BUILT)
	source ./env.sh; python -m pytest $(PYTEST_ARGS)

bags: $(BUILT)
	rm -rf build/scenes; source ./env.sh; make_scene --out build/scenes --seed 0 --tour-only; \
	import_dataset avd build/scenes/Gen_000_1 --out bags/aliased_room --seed 2

clean:
	rm -rf build install log out
