# `make demo` and `make test` set up .venv when they have to, then run. `make help` lists the rest.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help demo test test-all lint setup robot-server view ros-extras possible-extras doc clean distclean

# Python for a new .venv: the first of these that is there, in a version that fits, with what the set-up needs.
PYTHON ?= python3.11 python3.12 python3.10 python3
ARGS ?=
# test/conftest.py says which tests a worker is handed, and in which order.
workers := --dist=loadgroup --no-loadscope-reorder

python := .venv/bin/python
pytest := ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_PYTHON_CHECK_FIELDS=1 MPLBACKEND=Agg \
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 $(python) -m pytest $(workers) --durations=10
ready := .venv/.ready
robot_server := .venv-robot-server/.ready
view := .venv/.view
extras := .venv/.ros-extras
# numba compiles a kernel anew when its own file changes, not when that of a kernel it calls does.
kernels := .venv/.kernels
sources := $(shell grep -rl numba geodesic_motion_ros studies/geodesic_motion_studies --include='*.py')

# .venv is a world of its own: another virtual environment, a sourced ROS installation and what ROS's wheels put
# into the environment of their interpreter must not reach into it.
# With bytecode kept, no worker and none of the processes under test compiles all modules anew.
unexport PYTHONDONTWRITEBYTECODE
unexport LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONHOME PYTHONPATH VIRTUAL_ENV
unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH RMW_IMPLEMENTATION

help: ## this list
	@echo 'geodesic_motion_ros: make TARGET'
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/  \1\t\2/p' $(MAKEFILE_LIST) | expand -t 13
	@echo
	@echo "  make demo ARGS=--gui        opens PyBullet's window"
	@echo "  make demo ARGS='--skill panda_pouring'   the hand around the obstacle; ur5_reach: on a UR5"
	@echo "  make demo ARGS='--robot-server'   a simulated FR3 over Franka's own protocol, with all its reflexes"
	@echo "  make demo ARGS=--view       a page in the browser: drag obstacles into the path of the moving arm"
	@echo "  make test ARGS='-k skill'   some of the tests"
	@echo "  make test ARGS='-n 0'       one at a time, as --pdb needs it"
	@echo "  make PYTHON=python3.10 ...  the Python of a new .venv (3.10, 3.11 or 3.12)"

demo: $(kernels) $(if $(findstring --robot-server,$(ARGS)),$(robot_server)) $(if $(findstring --view,$(ARGS)),$(view)) ## a Panda takes its elbow out of a moving obstacle's path: two minutes, headless; pictures in out/demo
	@MPLBACKEND=Agg $(python) -m geodesic_motion_ros demo $(ARGS) < /dev/null

# Three on two cores: many tests wait. A worker of the studies may take 6 GB.
test: lint $(kernels) $(view) ## ruff and mypy, then the tests of the product, three at a time
	@$(pytest) --numprocesses=3 $(ARGS) < /dev/null

test-all: possible-extras test $(robot_server) ## these, then the tests of the studies and the whole demos
	@$(pytest) --numprocesses=auto --maxprocesses=2 studies/test $(ARGS) < /dev/null

lint: $(ready) ## ruff, and mypy over what plans
	@$(python) -m ruff check .
	@$(python) -m mypy

setup: $(kernels) ## .venv with the pinned requirements, kernels compiled, large latent graphs made; nothing more

robot-server: $(robot_server) ## .venv-robot-server: a simulated FR3 behind Franka's own protocol, for demo and test-all

view: $(view) ## the page in the browser into .venv, for geodesic-motion view, demo and the tests of it

ros-extras: $(extras) ## the action move_to_goal, follow_joint_trajectory, /tf and MoveIt's planning scene: compiled into .venv

# Where there is no compiler, their tests are skipped.
possible-extras: $(ready)
	@if $(python) .ci/ros_extras/build --possible < /dev/null; then $(MAKE) --no-print-directory $(extras); fi

doc: .venv-doc/.ready ## the pages as a site, in out/doc/doc/index.html; a link that leads nowhere is an error
	@.venv-doc/bin/python -m sphinx --quiet --fail-on-warning --keep-going -c doc . out/doc

.venv-doc/.ready: requirements-doc.txt
	@python3 -m venv .venv-doc
	@.venv-doc/bin/python -m pip install --disable-pip-version-check --quiet --no-deps -r requirements-doc.txt < /dev/null
	@touch $@

clean: ## removes out/ and what builds and tools leave behind
	rm -rf out build install log studies/build .pytest_cache .ruff_cache .mypy_cache .hypothesis
	@find . -path './.venv*' -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## clean, and .venv and .venv-robot-server too
	rm -rf .venv .venv-doc .venv-robot-server *.egg-info studies/*.egg-info

$(ready): requirements.txt setup.py studies/setup.py
	@.ci/setup $(PYTHON) < /dev/null

$(robot_server): $(ready) requirements-robot-server.txt requirements-franka.txt .ci/robot_server
	@.ci/robot_server < /dev/null

$(extras): $(ready) $(wildcard .ci/ros_extras/build .ci/ros_extras/*/*/*)
	@echo 'Compiling messages and actions: a minute, once.'
	@$(python) .ci/ros_extras/build < /dev/null
	@touch $@

$(view): $(ready) requirements-view.txt
	@$(python) -m pip install --disable-pip-version-check --quiet --no-deps -r requirements-view.txt < /dev/null
	@touch $@

$(kernels): $(ready) $(sources)
	@find geodesic_motion_ros studies/geodesic_motion_studies -name '*.nb[ic]' -delete
	@$(python) -m geodesic_motion_ros.kernels.compile_ahead < /dev/null
	@$(python) -m geodesic_motion_ros.skill.kept_graph < /dev/null
	@touch $@
