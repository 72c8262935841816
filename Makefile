# Everything from a fresh Debian 12 to the tests. `make` alone lists the targets.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

# dolfinx is built for the distribution's interpreter, whatever `python3` on the path may be.
PYTHON := /usr/bin/python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check -qq

# libopenblas0-serial: the reference BLAS is several times slower in the factorisations.
# The libraries of the last line are what the gmsh module loads, window or not.
DEBIAN_PACKAGES := python3-venv python3-dolfinx-real python3-gmsh python3-scipy python3-numba \
	python3-matplotlib python3-meshio python3-h5py-mpi python3-pytest python3-click \
	openmpi-bin libopenblas0-serial libcholmod3 libmetis5 \
	libegl1 libgl1 libxrender1 libxcursor1 libgomp1

# One thread per rank; Open MPI may run as root and on fewer cores than ranks.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export NUMBA_NUM_THREADS := 1
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
export OMPI_MCA_hwloc_base_binding_policy := none
export OMPI_MCA_rmaps_base_oversubscribe := 1
# Packages in a home directory must not shadow those of the distribution.
export PYTHONNOUSERSITE := 1

.PHONY: help setup setup-network setup-test system demo test bench bench-check measures lint clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 20

setup: .venv/.stamp-base ## install what is missing and build .venv (no torch)

setup-network: .venv/.stamp-network ## the same, with torch for the network

setup-test: .venv/.stamp-test ## the same, with the development tools too

demo: setup-network ## press the built-in wheelset, on uniform and on rough friction, and say where the figures are
	$(BIN)/macrofit study wheelset --set friction.provider=surrogate --vary friction.options.micro_friction=0.07 \
	    --reference uniform=0.11 --set 'output.fields_at=[22,180]' --keep -o demo
	@echo "The figures are:" && ls -1 demo/*.png demo/runs/*/*.png

# Files of tests are dealt out to as many processes as there are cores; PROCESSES=0 runs them in one.
PROCESSES := auto --maxprocesses 8
PYTEST := $(BIN)/python -m pytest -n $(PROCESSES)

test: setup-test ## the tests, a process for each core, then the MPI ones on two ranks
	$(PYTEST) --dist loadfile --durations=10
	timeout 600 mpirun -n 2 $(BIN)/python -m pytest -m mpi tests

NAMES :=
bench: setup-test ## measure everything anew (an hour) and write docs/benchmarks.md; NAMES="cost sweep" for some
	$(BIN)/python -m tests.benchmarks book $(NAMES)

bench-check: setup-test ## every benchmark in its toy size, to see that it runs
	$(PYTEST) --dist worksteal tests/benchmarks/test_quick.py

measures: setup-test ## print how the code is divided, how long, typed and documented it is, and the bars
	$(BIN)/python -m tests.code_measures --places

lint: setup-test ## style, types and who imports whom
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

clean: ## remove .venv, the demo and every cache
	rm -rf .venv demo build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Asks the package database each time, and touches the system only when something is missing.
system:
	@command -v dpkg-query > /dev/null || { echo "The set-up needs Debian 12 or later." >&2; exit 1; }
	@present=$$(dpkg-query -W -f='$${db:Status-Abbrev} $${Package}\n' $(DEBIAN_PACKAGES) 2> /dev/null \
	    | sed -n 's/^ii *//p' || true); \
	missing=$$(comm -23 <(printf '%s\n' $(DEBIAN_PACKAGES) | sort -u) <(echo "$$present" | sort -u)); \
	if [ -n "$$missing" ]; then \
	    sudo=; \
	    if [ "$$(id -u)" != 0 ]; then \
	        command -v sudo > /dev/null \
	            || { echo "Run as root, or install:" $$missing >&2; exit 1; }; \
	        sudo=sudo; \
	    fi; \
	    echo "Installing Debian packages:" $$missing; \
	    $$sudo apt-get update -qq || echo "The package lists could not be refreshed; going on." >&2; \
	    $$sudo env DEBIAN_FRONTEND=noninteractive \
	        apt-get install -y -qq --no-install-recommends $$missing; \
	fi

.venv/.stamp-base: pyproject.toml constraints.txt | system
	$(PYTHON) -m venv --system-site-packages .venv
	$(PIP) install -c constraints.txt setuptools
	$(PIP) install -c constraints.txt --no-build-isolation -e .
	@touch $@

.venv/.stamp-network: .venv/.stamp-base
	$(PIP) install -c constraints.txt --no-build-isolation -e '.[surrogate]'
	@touch $@

.venv/.stamp-test: .venv/.stamp-base
	$(PIP) install -c constraints.txt --no-build-isolation -e '.[surrogate,dev]'
	@touch $@
