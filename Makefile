# Needs Python 3.11, g++ and make; everything else comes into .venv by pip. `make demo` installs the package and what
# it needs; the targets that check install the test tools, torch and stable-baselines3 besides.
VENV ?= .venv
PYTHON ?= $(shell command -v python3.11 || command -v python3 || echo python3)
bin := $(VENV)/bin
pip := $(bin)/python -m pip --disable-pip-version-check install -qq -c constraints.txt
cpp := $(wildcard CMakeLists.txt plugin_cpp/mrdamp.h plugin_cpp/*/*.cc plugin_cpp/*/*.h plugin_cpp/*/*.def plugin_cpp/device/*.cu plugin_cpp/device/std/*)
cpp_tests := BIN=$(bin) tools/cpp_tests.sh
fuzz_seconds ?= 60
# Pictures without a display where EGL is there; else MuJoCo's own choice.
ifndef MUJOCO_GL
  egl := import ctypes; ctypes.CDLL("libEGL.so.1"); print("egl")
  export MUJOCO_GL := $(shell $(PYTHON) -c '$(egl)' 2>/dev/null)
endif

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: always help venv build tools demo test check-all bench bench-gpu studies mutants docs lint cpp-test sanitize tsan arm fuzz wheel-test clean

help:  ## list the targets
	@sed -nE 's/^([a-z-]+):.*  ## (.*)/  make \1\t\2/p' Makefile | expand -t 19

# --- set-up and build -------------------------------------------------------------------
venv: $(VENV)/.set-up  ## make .venv (again only when pyproject.toml or constraints.txt changes)

$(VENV)/.set-up: pyproject.toml constraints.txt
	@command -v g++ >/dev/null || { echo "make: g++ not found; install it (Debian: apt install g++)" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "make: $(PYTHON) is missing or older than 3.11; name another: make PYTHON=python3.11" >&2; exit 1; }
	@echo "set-up: $(VENV), $$($(PYTHON) --version)"
	@$(bin)/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  $(PYTHON) -m venv --clear $(VENV) || { \
	  echo "make: $(PYTHON) cannot make a virtual environment (Debian: apt install python3-venv)" >&2; exit 1; }
	@$(pip) scikit-build-core mujoco-core cmake ninja
	@touch $@

build: build/.installed  ## install the package and what it needs into .venv; compile the plugin when C++ has changed

# Editable: Python code runs where it stands. The build folder is kept, so only changed files compile. The install
# knows each module by its path, so that one which moves needs another install.
build/.modules: always
	@mkdir -p build
	@find -L src/mrdamp -name '*.py' | sort >$@.new && if cmp -s $@.new $@; then rm $@.new; else mv $@.new $@; fi

build/.installed: $(VENV)/.set-up $(cpp) build/.modules
	@echo "build: the package and its plugin"
	@$(pip) --no-build-isolation -Cbuild-dir=build/plugin -Ccmake.define.MRDAMP_WERROR=ON -e .
	@touch $@

tools: $(VENV)/.tools  ## add the test tools, torch and stable-baselines3 to .venv (torch_index=URL: torch's CPU build)

# The package is there already, so that this installs the requirements of its extras alone.
$(VENV)/.tools: $(VENV)/.set-up | build/.installed
	@echo "set-up: test tools, torch, stable-baselines3"
	@$(pip) $(if $(torch_index),--extra-index-url $(torch_index)) 'mrdamp[dev,train]'
	@touch $@

demo: build  ## the main job on the project's own records; page: out/demo/index.html
	@$(bin)/mrdamp demo -o out/demo

# --- checks -----------------------------------------------------------------------------
test: tools lint sanitize  ## C++ tests under sanitizers, ruff, mypy, pytest without the slow ones
	@$(bin)/python -m pytest -n 2 -m "not slow"

check-all: tools lint cpp-test sanitize tsan arm fuzz wheel-test docs  ## test, plain C++ tests, slow tests, mutants, thread sanitizer, 64-bit ARM, fuzzing, wheel, docs
	@$(pip) 'mrdamp[warp,cuda]'
	@$(bin)/python -m pytest -n 2
	@$(MAKE) --no-print-directory mutants

mutants: build tools  ## wrong signs, factors, units and terms of the physics: does a test fail? (goes on where it stopped)
	@PATH="$(abspath $(bin)):$$PATH" $(bin)/python tools/mutants.py

lint: build tools  ## ruff and mypy
	@$(bin)/ruff check .
	@$(bin)/mypy

cpp-test: build  ## C++ tests
	@$(cpp_tests) cpp

sanitize: build  ## C++ tests under the address and undefined-behaviour sanitizers
	@$(cpp_tests) sanitize -DMRDAMP_SANITIZE=address,undefined

tsan: build  ## C++ tests under the thread sanitizer
	@$(cpp_tests) tsan -DMRDAMP_SANITIZE=thread

arm: build  ## C++ tests for 64-bit ARM, where its compiler and QEMU are there (Debian: g++-aarch64-linux-gnu qemu-user)
	@if command -v aarch64-linux-gnu-g++ >/dev/null && command -v qemu-aarch64 >/dev/null; then \
	  $(cpp_tests) arm -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 -DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++ \
	    -DCMAKE_C_COMPILER=aarch64-linux-gnu-gcc '-DCMAKE_CROSSCOMPILING_EMULATOR=qemu-aarch64;-L;/usr/aarch64-linux-gnu'; \
	else echo "make: no aarch64-linux-gnu-g++ or no qemu-aarch64; the C++ tests for 64-bit ARM are left out"; fi

fuzz: build  ## fuzz every target for 60 s in all (fuzz_seconds=...)
	@BIN=$(bin) tools/fuzz.sh $(fuzz_seconds)

wheel-test: build tools  ## sdist, wheel from it, installed and tried in a fresh environment elsewhere
	@BIN=$(bin) tools/wheel_test.sh

docs: build  ## the documentation site: out/site/index.html
	@$(pip) mkdocs-material mkdocstrings mkdocstrings-python
	@$(bin)/python tools/command_reference.py
	@$(bin)/mkdocs build --strict

# OpenSees' wheel does not find its own libraries without the path.
bench: build tools  ## speed, as ratios, beside OpenSeesPy where it can be had
	@$(pip) openseespy || echo "bench: OpenSeesPy cannot be installed; its rows are left out"
	@LD_LIBRARY_PATH="$$(echo $(abspath $(VENV))/lib/python3.*/site-packages/openseespylinux/lib)" \
	  $(bin)/python -m benchmarks

bench-gpu: build  ## the chain on a GPU over one core; needs a card
	@$(pip) 'mrdamp[cuda]'
	$(bin)/python -m benchmarks.gpu

studies: build tools  ## the studies behind tables of the docs (studies/README.md; some days)
	@BIN=$(bin) studies/all.sh

clean:  ## remove what was built; .venv and out/ stay
	@rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
