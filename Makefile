# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# make setup    .venv with everything: ROS 2, the message package, identnl_ros
# make demo     the demonstration
# make test     all tests; arguments for pytest: make test TESTS='tests/core -k contact'
#               JOBS=2 tells how many processes share them
# make bench    the benchmarks against peers
# make study    the Monte-Carlo studies; tables go to studies/results (hours)
# make lint     ruff and mypy
# make lock     renew requirements.lock from setup.py and requirements.in
# make clean    remove .venv and what builds and tests leave behind
#
# PYTHON=<command> chooses the Python interpreter (3.11 or newer) that .venv is made from.

PYTHON ?=
TESTS ?= tests
JOBS ?= 2

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

# Stamps are made last: what was interrupted is done again.
MADE := $(VENV)/.made
PACKAGES := $(VENV)/.packages
MESSAGES := $(VENV)/.messages
INSTALLED := $(VENV)/.installed

# Folders stand for files that went away.
MESSAGE_SOURCES := $(shell find msg_defs -name build -prune -o -print)

# ROS talks to this machine only, unless told otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# .venv stands alone, also beside a ROS installation that is sourced in this shell.
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONHOME PYTHONPATH PIP_USER
# The ROS wheels' start-up hook marks its work in the environment. Called from the Python of
# another environment, the mark would keep it from running in this one.
ifdef _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH
endif

.PHONY: setup demo test bench study lint lock clean
.DELETE_ON_ERROR:

setup: $(INSTALLED) $(MESSAGES)

demo: setup
	@$(BIN)/identnl demo

test: setup
	@$(BIN)/python -m pytest --numprocesses $(JOBS) --dist loadfile $(TESTS)

bench: setup
	@$(BIN)/python benchmarks/run.py

study: setup
	@$(BIN)/python studies/noise.py --estimator weak --runs 1000
	@$(BIN)/python studies/noise.py --estimator likelihood --runs 200
	@$(BIN)/python studies/inner.py --weak 200 --likelihood 60
	@$(BIN)/python studies/degraded.py --runs 200
	@$(BIN)/python studies/hidden_effects.py --excitation multisine --group one --group null
	@$(BIN)/python studies/hidden_effects.py --excitation multisine --group outside \
	    --group strong --group two --group three --out hidden_effects_more
	@$(BIN)/python studies/hidden_effects.py --excitation sine --out hidden_effects_sine
	@$(BIN)/python studies/stream_alignment.py
	@$(BIN)/python studies/data_quality_channels.py
	@$(BIN)/python studies/data_quality_consistency.py

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

$(MADE): | tools/prerequisites.sh
	@python=$$(tools/prerequisites.sh $(PYTHON)) && \
	echo "Making $(VENV) with $$python" && \
	"$$python" -m venv --clear $(VENV)
	@touch $@

# setuptools first: it builds the few packages that come as source.
$(PACKAGES): requirements.lock $(MADE)
	@echo 'Installing the packages of requirements.lock (about 1.1 GB on disk)'
	@grep '^setuptools==' requirements.lock | $(PIP) install --requirement /dev/stdin
	@$(PIP) install --no-build-isolation --use-pep517 --requirement requirements.lock
	@touch $@

$(MESSAGES): $(MESSAGE_SOURCES) $(PACKAGES)
	@echo 'Building the message package identnl_msgs'
	@$(PIP) install --no-build-isolation --no-deps --force-reinstall ./msg_defs
	@touch $@

$(INSTALLED): setup.py setup.cfg package.xml $(PACKAGES)
	@echo 'Installing identnl_ros, editable'
	@$(PIP) install --no-build-isolation --no-deps --editable .
	@touch $@

# The oldest Python has the fewest versions to choose from: they serve the newer ones too.
lock:
	@python=$$(tools/prerequisites.sh $(PYTHON)) && \
	"$$python" -m venv --clear $(VENV)/lock && \
	$(VENV)/lock/bin/pip --quiet install uv && \
	UV_CUSTOM_COMPILE_COMMAND='make lock' $(VENV)/lock/bin/uv pip compile --quiet --upgrade \
	    --python-version 3.11 --python-platform linux --no-emit-index-url --extra formats \
	    --extra nidaqmx --extra opendaq --extra test --output-file requirements.lock setup.py requirements.in
	@rm -rf $(VENV)/lock

clean:
	rm -rf $(VENV) build dist install log msg_defs/build *.egg-info results
	rm -rf .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
