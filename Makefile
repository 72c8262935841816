# Everything from a fresh Debian 12 or 13 to the tests. `make` alone lists the targets.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.ONESHELL:

# dolfinx is built for the distribution's interpreter, whatever `python3` on the path may be.
PYTHON := /usr/bin/python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check -q install -c constraints.txt -c .venv/numpy.txt

OS_RELEASE := /etc/os-release
RELEASE := $(shell { . $(OS_RELEASE) && echo "$$ID-$${VERSION_ID-}" || echo unknown; } 2> /dev/null)
BUILT := .venv/.$(RELEASE)

# libopenblas0-serial: the reference BLAS is several times slower in the factorisations.
# The libraries of the last line are what the gmsh module loads, window or not.
PACKAGES := python3-venv python3-dolfinx-real python3-gmsh python3-scipy python3-numba \
	python3-matplotlib python3-meshio python3-h5py-mpi python3-pytest python3-click python3-jinja2 \
	openmpi-bin libopenblas0-serial libmetis5 \
	libegl1 libgl1 libxrender1 libxcursor1 libgomp1
PACKAGES_debian-12 := libcholmod3
# There the parallel h5py is empty without the serial one, and torch is a package of the distribution.
PACKAGES_debian-13 := libcholmod5 python3-h5py
TORCH_debian-13 := python3-torch python3-safetensors
# The browser in which the tests read the report's page.
BROWSER := chromium
# What any other release must have.
MODULES := venv dolfinx petsc4py mpi4py gmsh scipy numba matplotlib meshio h5py

# One thread per rank; Open MPI may run as root and on fewer cores than ranks.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export NUMBA_NUM_THREADS := 1
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
export OMPI_MCA_hwloc_base_binding_policy := none
export OMPI_MCA_rmaps_base_oversubscribe := 1
# The same for Open MPI 5, of Debian 13.
export PRTE_MCA_hwloc_default_binding_policy := none
export PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe
# Packages in a home directory must not shadow those of the distribution.
export PYTHONNOUSERSITE := 1

.PHONY: help setup setup-network setup-test setup-docs system system-torch system-test demo test fresh bench bench-check networks docs measures lint clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24

setup: system $(BUILT) $(BUILT)-compiled ## install what is missing and build .venv (no torch)

# A run of the plates with either engine: what the first one would compile for ten seconds is kept.
$(BUILT)-compiled: $(BUILT)
	@$(FUNCTIONS)
	folder=$$(mktemp -d)
	for engine in explicit quasi-static; do
	    quietly "The first run of the plates" $(BIN)/macrofit-meso run --quiet --engine $$engine -o $$folder/plates
	done
	rm -rf $$folder
	touch $@

setup-network: system-torch $(BUILT)-network ## the same, with torch for the network

setup-test: system-test $(BUILT)-test ## the same, with the development tools too

setup-docs: system $(BUILT)-docs ## what `make setup` does, and what builds the manual

demo: setup-network ## press the built-in wheelset on uniform friction, on plates as published and on slow ones
	@(set -x; $(BIN)/macrofit study wheelset --set friction.provider=surrogate \
	    --set friction.options.micro_friction=0.07 --vary friction.options.plates=as-published,slow \
	    --reference uniform=0.11 --set 'output.fields_at=[22,180]' --keep -o demo)
	$(BIN)/python docs/examples/demo_page.py demo

# Files of tests are dealt out to as many processes as there are cores; PROCESSES=0 runs them in one.
TESTS := tests
PROCESSES := auto --maxprocesses 8
PYTEST := $(BIN)/python -m pytest -n $(PROCESSES)

test: setup-test ## the tests, a process for each core, then the MPI ones on two ranks; TESTS="tests/unit" for some
	$(PYTEST) --dist loadfile --durations=10 $(TESTS)
	timeout 600 mpirun -n 2 $(BIN)/python -m pytest -m mpi $(TESTS)

SUITE :=
fresh: ## the same from empty, in Debian 12 and 13 made for it (as root); SUITE=trixie for one
	tests/fresh $(SUITE)

NAMES :=
bench: setup-test ## measure everything anew (an hour) and write docs/benchmarks.md; NAMES="cost sweep" for some
	$(BIN)/python -m tests.benchmarks book $(NAMES)

bench-check: setup-test ## every benchmark in its toy size, to see that it runs
	$(PYTEST) --dist worksteal tests/benchmarks/test_quick.py

PRESETS := slow as-published
PAIRS := 1000
MODELS := surrogate/network/models
DATA := build/networks
UNSEEN := --packings 3 --first-surface 31000 --first-packing 2000 --micro-friction 0.03,0.05,0.07,0.09
WIDE_PAIRS := 1200
WIDE_UNSEEN := --packings 3 --first-packing 2000 --micro-friction 0.02,0.06,0.12,0.3
# The roughest part of the wide design has few of its pairs, and differs most: more of them.
ROUGH := --design wide --max-height 0.02,0.1
ROUGH_PAIRS := 400
# In the roughest part the mean of three packings is off by as much as the network: nine of them.
ROUGHEST := --design wide --max-height 0.05,0.1 --pressure 30,300 --pairs 20 --packings 9 --first-packing 2000 --micro-friction 0.06,0.12,0.3
networks: setup-network ## make the shipped networks anew from friction tests of theirs (an hour); PRESETS=slow for some
	@mkdir -p $(DATA)
	surrogate() { (set -x; $(BIN)/macrofit-surrogate "$$@"); }
	for preset in $(PRESETS); do
	    made=$(DATA)/$$preset
	    surrogate generate --preset $$preset -o $$made.h5 --pairs $(PAIRS)
	    surrogate generate --preset $$preset -o $$made-evaluation.h5 --pairs 101 $(UNSEEN)
	    case $$preset in
	        slow)
	            surrogate generate --design wide -o $(DATA)/wide.h5 --pairs $(WIDE_PAIRS)
	            surrogate generate $(ROUGH) -o $(DATA)/rough.h5 --pairs $(ROUGH_PAIRS) --first-surface 2000
	            surrogate generate --design wide -o $(DATA)/wide-evaluation.h5 --pairs 63 $(WIDE_UNSEEN) --first-surface 41000
	            surrogate generate $(ROUGH) -o $(DATA)/rough-evaluation.h5 --pairs 40 $(WIDE_UNSEEN) --first-surface 42000
	            surrogate generate $(ROUGHEST) -o $(DATA)/roughest-evaluation.h5 --first-surface 43000
	            surrogate train $(DATA)/wide.h5 $(DATA)/rough.h5 $$made.h5 -o $$made-energy.safetensors --epochs 3000 --points 17
	            surrogate table $(DATA)/wide-evaluation.h5 -o $(MODELS)/wide-evaluation.csv.gz
	            surrogate table $(DATA)/rough-evaluation.h5 -o $(MODELS)/rough-evaluation.csv.gz
	            surrogate table $(DATA)/roughest-evaluation.h5 -o $(MODELS)/roughest-evaluation.csv.gz
	            surrogate train $$made.h5 -o $$made-envelope.safetensors --faces envelope
	            surrogate train $(DATA)/wide.h5 $$made.h5 -o $$made-cnn.safetensors --architecture paper --points 17
	            surrogate table $$made-evaluation.h5 -o $(MODELS)/evaluation.csv
	            cp $$made-energy.safetensors $(MODELS)/energy.safetensors
	            cp $$made-envelope.safetensors $(MODELS)/envelope.safetensors
	            cp $$made-cnn.safetensors $(MODELS)/paper.safetensors ;;
	        *)
	            surrogate train $$made.h5 -o $$made-energy.safetensors
	            surrogate train $$made.h5 -o $$made-cnn.safetensors --architecture paper --points 9 --seeds 5
	            surrogate table $$made.h5 -o $(MODELS)/$$preset-train.csv.gz
	            surrogate table $$made-evaluation.h5 -o $(MODELS)/$$preset-evaluation.csv.gz
	            cp $$made-energy.safetensors $$made-cnn.safetensors $(MODELS)
	            cp $$made-cnn.loss.png docs/$$preset-loss.png ;;
	    esac
	    surrogate evaluate --preset $$preset -o $$made-evaluated
	done

docs: setup-docs ## the manual as a site that needs no network, build/site/index.html; a warning fails
	@$(BIN)/mkdocs build --strict
	echo "Open build/site/index.html"

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

# Shell functions of the recipes below. quietly WHAT COMMAND... says nothing unless the command fails; then, one line.
define FUNCTIONS
fail() {
	echo "$$*" >&2
	exit 1
}
quietly() {
	local what=$$1 text
	shift
	text=$$("$$@" 2>&1 < /dev/null) && return
	case $$text in
	    *"No space left"* | *"enough free space"*)
	        text="the disk is full: free 5 GB and type make again" ;;
	    *"emporary failure"* | *"ould not resolve"* | *"new connection"* | *NewConnectionError* | *ProxyError* \
	        | *"Failed to fetch"* | *"Unable to locate package"* | *"no installation candidate"* | *"timed out"*)
	        text="the network or the package index does not answer: mend that and type make again" ;;
	    *"held by process"*)
	        text="another program is installing: wait for its end and type make again" ;;
	    *)
	        text=$$(grep -iE '^(E:|error)' <<< "$$text" || tail -n 1 <<< "$$text") ;;
	esac
	fail "$$what:" $$text
}
with_torch() { # with_torch EXTRA
	$(BIN)/python -c 'import torch' 2> /dev/null \
	    || echo "Loading torch: 200 MB, or several GB where the index has only the build for GPUs"
	quietly "Python packages" $(PIP) --no-build-isolation -e ".[$$1]"
}
endef

# Asks the package database each time, and touches the system only when something is missing.
system: WANTED := $(PACKAGES) $(PACKAGES_$(RELEASE))
system-torch: WANTED := $(PACKAGES) $(PACKAGES_$(RELEASE)) $(TORCH_$(RELEASE))
system-test: WANTED := $(PACKAGES) $(PACKAGES_$(RELEASE)) $(TORCH_$(RELEASE)) $(BROWSER)
ifneq ($(PACKAGES_$(RELEASE)),)
system system-torch system-test:
	@$(FUNCTIONS)
	present=$$(dpkg-query -W -f='$${db:Status-Abbrev} $${Package}\n' $(WANTED) 2> /dev/null | sed -n 's/^ii *//p' || true)
	missing=$$(comm -23 <(printf '%s\n' $(WANTED) | sort -u) <(sort -u <<< "$$present") | paste -sd ' ')
	[ -n "$$missing" ] || exit 0
	sudo=
	if [ "$$(id -u)" != 0 ]; then
	    sudo="sudo -n"
	    { sudo -n true || { [ -t 0 ] && sudo -v; }; } 2> /dev/null \
	        || fail "Debian packages are missing, and this user has no sudo. As root, type:" \
	            "apt-get update && apt-get install -y --no-install-recommends $$missing"
	fi
	apt="$$sudo env DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get --no-install-recommends -o DPkg::Lock::Timeout=60"
	$$apt update -qq > /dev/null 2>&1 || true # old lists may do
	load=$$($$apt install --assume-no $$missing 2> /dev/null \
	    | sed -nE 's/^Need to get ([0-9.]+ [kM]?B).*/\1/p' || true)
	case $$load in *" MB") minutes=$$((1 + $${load%%[. ]*} / 200)) ;; *) minutes=1 ;; esac
	echo "Installing Debian packages: $${load:-nobody knows how much} to load, about $$minutes min"
	quietly "Debian packages" $$apt install -y -qq $$missing
else
system system-torch system-test:
	@$(FUNCTIONS)
	lacks=$$($(PYTHON) -c 'from importlib.util import find_spec; import sys;
	    print(*(name for name in sys.argv[1:] if not find_spec(name)))' $(MODULES) 2> /dev/null) || lacks=everything
	[ -z "$$lacks" ] || fail "$(RELEASE) is untried, and $(PYTHON) lacks $$lacks: take Debian 12 or 13," \
	    "or install these and name their interpreter, make PYTHON=/path/to/python3"
	echo "$(RELEASE) is untried, known are Debian 12 and 13; going on with what $(PYTHON) has" >&2
endif

$(BUILT): pyproject.toml constraints.txt
	@$(FUNCTIONS)
	quietly "The Python environment .venv" $(PYTHON) -m venv --system-site-packages .venv
	$(PYTHON) -c 'import numpy; print(f"numpy=={numpy.__version__}")' > .venv/numpy.txt
	quietly "Python packages" $(PIP) setuptools
	quietly "Python packages" $(PIP) --no-build-isolation -e .
	dolfinx=$$($(BIN)/python -c 'from importlib.metadata import version; print(version("fenics-dolfinx"))')
	case $$dolfinx in 0.5.* | 0.9.*) ;; *) echo "dolfinx $$dolfinx is untried, known are 0.5 and 0.9" >&2 ;; esac
	touch $@

$(BUILT)-network: $(BUILT)
	@$(FUNCTIONS)
	with_torch surrogate
	touch $@

$(BUILT)-test: $(BUILT)
	@$(FUNCTIONS)
	with_torch surrogate,dev
	touch $@

$(BUILT)-docs: $(BUILT)
	@$(FUNCTIONS)
	quietly "Python packages" $(PIP) --no-build-isolation -e ".[docs]"
	touch $@
