# Everything a clone needs, typed as one word. `make help` lists the words.
#
# Needs Rust (cargo), Python 3.10 or newer with venv, and make. The rest goes into .venv, out and
# target, all of which git ignores.

PY ?= python3
VENV := .venv
BIN := $(VENV)/bin
TARGET := $(if $(CARGO_TARGET_DIR),$(CARGO_TARGET_DIR),target)

# One interpreter for every compilation of the Python module, so that none undoes another's work.
export PYO3_PYTHON := $(shell $(PY) -c 'import os, sys; print(os.path.realpath(sys._base_executable))' 2>/dev/null)

# Tests start thousands of interpreters. Each would compile the package anew where nothing of that may be kept.
unexport PYTHONDONTWRITEBYTECODE

# What has no build for an interpreter without a global lock is not installed there; tests that need it are skipped.
ifneq ($(shell $(PY) -c 'import sysconfig; print(sysconfig.get_config_var("Py_GIL_DISABLED") or "")' 2>/dev/null | grep 1),)
export UV_EXCLUDE := requirements-not-free-threaded.txt
endif

# How many tests in Python run at a time: they wait more than they compute.
WORKERS ?= 4

PYTHON_CODE := python tests bench examples docs packaging
# Programs that the strictest checks of types must accept, as those of users who run them.
TYPED_PROGRAMS := tests/twins $(filter-out examples/broadcast_gather/% examples/ros2_port/%,$(wildcard examples/*/*.py))
RUST_SOURCES := Cargo.toml Cargo.lock \
	$(shell find crates -path crates/hprm-agent -prune -o -name '*.rs' -o -name 'Cargo.toml' -o -path '*/explanation/*.md' -o -path '*/templates/*' -o -path '*/font/*' -type f)

# What the tests in Rust are made of: all of it, the command as in the wheel, so that cargo chooses the same features
# for what it has compiled for the extension, and compiles that once.
TESTED := --workspace --features hprm-cli/whole

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: lint-other help build wheel try-wheel deny hooks demo drive docs docs-rust test check acceptance check-model sim-nightly conformance conformance-ros2 agent test-agent test-fleet bench bench-quick evaluation bench-ordering bench-ros2 bench-growth bench-watching bench-ros2-order bench-rust bench-rust-federations bench-python bench-in-process bench-in-parallel mutants bench-frames bench-grants bench-fleet bench-agents fmt lint clean toolchain

help: ## list these targets
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "  make %-16s %s\n", $$1, $$2 }' Makefile

build: $(VENV)/.whole ## build the command `hprm` and the Python package into .venv

# With the C library of zig, so that the wheel runs on other distributions and older ones.
WHEEL_FOR ?= manylinux_2_28
wheel: $(VENV)/.wheel-requirements ## build a wheel for this version of Python, for any Linux, into out/wheels
	MATURIN_PEP517_ARGS="--zig --compatibility $(WHEEL_FOR)" PATH="$(CURDIR)/$(BIN):$$PATH" \
	  $(BIN)/python -m pip wheel --verbose --disable-pip-version-check --no-build-isolation --no-deps \
	  --wheel-dir out/wheels .

docs: build $(VENV)/.requirements ## build the handbook into out/handbook
	$(BIN)/sphinx-build -W --keep-going -q docs out/handbook
	@echo "open out/handbook/index.html"

docs-rust: toolchain ## build the reference of the Rust library into target/doc
	cargo doc --quiet --no-deps -p hprm
	@echo "open $(TARGET)/doc/hprm/prelude/index.html"

try-wheel: $(VENV)/.requirements ## install the wheel of out/wheels where there is no compiler, test it there, time its import
	HPRM_WHEEL="$$(ls -t out/wheels/hprm-*.whl | head -n 1)" $(BIN)/python -m pytest tests/python/test_wheel.py
	$(BIN)/python bench/importing.py "$$(ls -t out/wheels/hprm-*.whl | head -n 1)"

demo: $(VENV)/.built $(VENV)/.demo-requirements ## run the broadcast and gather example, print its table, draw its picture
	@$(BIN)/python examples/broadcast_gather/demo.py

drive: $(VENV)/.built $(VENV)/.demo-requirements $(VENV)/.driving-requirements ## drive through a town: a film, frames a second, and a box plot of how long frames take
	@cd examples/driving && $(CURDIR)/$(BIN)/python -m autopilot.demo

# The mutants need nothing but a compiler, so they have what the processors have left all the time. By this name,
# `make -n test` does not run them.
AGAIN := $(MAKE) --no-print-directory
test: toolchain ## check format and lints, then run all Rust and Python tests, and the mutants beside them
	@cargo --version
	$(PY) tests/beside.py $(PY) tests/mutants/run.py -- $(AGAIN) check

# What is tested is compiled by clippy's driver: one compilation for lints and tests, which `cargo clippy` is not. It
# denies warnings in the crates of this workspace, and sees others as rustc does.
check test-agent: export RUSTC_WORKSPACE_WRAPPER := $(CURDIR)/tests/compiler.sh
check test-agent: export CLIPPY_ARGS := -Dwarnings
# As maturin compiles the extension, or cargo would compile that again whenever the two follow one another. No test is
# linked to it: `--all-targets` would make one.
check test-agent: export PYO3_BUILD_EXTENSION_MODULE := 1
check test-agent: export PYO3_ENVIRONMENT_SIGNATURE := $(shell $(PY) -c 'import struct, sys; print("%s-%d.%d-%dbit" % (sys.implementation.name, *sys.version_info[:2], 8 * struct.calcsize("P")))' 2>/dev/null)
check: lint-other $(VENV)/.checked $(VENV)/.requirements ## the same without the mutants
	cargo build $(TESTED) --lib --bins --tests --benches --examples
	cargo test $(TESTED)
	$(BIN)/python -m pytest tests/python -n $(WORKERS) --dist worksteal
	$(AGAIN) test-agent

mutants: toolchain ## put faults into copies of the coordination; simulation must find all of them
	$(PY) tests/mutants/run.py

check-model: toolchain ## go every way in which small federations can go, for some minutes
	cargo test -p hprm-sim --test model -- --nocapture --include-ignored --test-threads 2

acceptance: build $(VENV)/.requirements ## the long form of some tests: pauses, orders of starting, equal runs, kills
	HPRM_ACCEPTANCE=1 $(BIN)/python -m pytest tests/python/test_acceptance.py \
		tests/python/test_memory.py tests/python/test_readers.py \
		tests/python/test_random_programs.py tests/python/test_driving.py

FIRST ?= 0
sim-nightly: toolchain ## a million random federations in a simulated network; FIRST= names the first seed
	cargo run --quiet --release -p hprm-cli --features sim -- sim --seed $(FIRST) --seeds 1000000

conformance: build $(VENV)/.requirements ## run Lingua Franca's own tests; LF= names a checkout of its repository
	@test -n "$(LF)" || { echo "error: which checkout? make conformance LF=path" >&2; exit 1; }
	$(BIN)/python tests/conformance/run.py "$(LF)" --single-threaded

# Its nodes are another implementation, in Rust, whose 400 crates take some minutes to compile.
conformance-ros2: build $(VENV)/.requirements ## talk to nodes of ROS 2 that HPRM has not written, over Zenoh
	cargo build --quiet --locked --manifest-path tests/hiroz/Cargo.toml --target-dir out/hiroz
	$(BIN)/python tests/hiroz/run.py out/hiroz/debug/hprm-hiroz

# Zenoh and its 300 crates take some minutes, so the agent is in no other build for users.
AGENT := out/agent/release/hprm-agent
agent: $(VENV)/.build-requirements ## build the command `hprm-agent`, which leads links between machines, into out/agent and .venv
	cargo build --release --locked --manifest-path crates/hprm-agent/Cargo.toml --target-dir out/agent
	cp $(AGENT) $(BIN)/hprm-agent
	@echo "$(BIN)/hprm agent --help"

# Without optimization, Zenoh compiles in a quarter of the time. These tests wait most of the time, so there are more of them
# at a time than of others.
CHECKED_AGENT := --locked --manifest-path crates/hprm-agent/Cargo.toml --target-dir target/agent
test-agent: $(VENV)/.checked $(VENV)/.requirements ## of `make test`, what runs federations through agents that pause, end and are cut off
	cargo fmt --check --manifest-path crates/hprm-agent/Cargo.toml
	cargo build $(CHECKED_AGENT) --bins --tests
	cargo test $(CHECKED_AGENT)
	HPRM_AGENT_PROGRAM=$(CURDIR)/target/agent/debug/hprm-agent \
		$(BIN)/python -m pytest tests/agents --ignore tests/agents/test_fleet.py -n 4 --dist worksteal

test-fleet: build agent ## run a federation of a hundred federates on ten machines, by nothing but agents
	$(BIN)/python -m pytest tests/agents/test_fleet.py

BENCH ?=
bench: build $(VENV)/.requirements ## compare with all peers side by side, half an hour; BENCH= options; then bench-ordering
	@$(BIN)/python bench/peers/run.py $(BENCH)
	@$(BIN)/python bench/ordering.py

bench-quick: build $(VENV)/.requirements ## a few minutes of that comparison, to see that everything works
	@$(BIN)/python bench/peers/run.py --quick $(BENCH)

EVALUATION ?=
evaluation: build $(VENV)/.requirements ## make every figure of the paper again, most of an hour, and a page; EVALUATION= options, as in --quick
	@$(BIN)/python bench/evaluate.py $(EVALUATION)

bench-ordering: build $(VENV)/.requirements ## count messages out of order on a loaded machine, with tags and without
	@$(BIN)/python bench/ordering.py

bench-ros2: build $(VENV)/.requirements ## measure programs of ROS 2: messages beside Cyclone DDS and Zenoh, a timer, a launch
	@$(BIN)/python bench/ros2_programs.py

bench-growth: build $(VENV)/.requirements ## what 2 to 64 federates and larger messages cost: a page of pictures, a quarter of an hour
	@$(BIN)/python bench/growth.py

bench-watching: build $(VENV)/.requirements ## what traces, top, rate and echo cost the federation that they look at
	@$(BIN)/python bench/watching.py

bench-ros2-order: build $(VENV)/.requirements ## run programs of ROS 2 on a loaded machine, ten times each, with tags and without
	@$(BIN)/python bench/ros2_order.py

# Boomerang needs features that its compiler's version still calls unstable.
bench-rust: toolchain ## compare the scheduler with boomerang, both in Rust, side by side
	@RUSTC_BOOTSTRAP=1 cargo run --quiet --release --manifest-path bench/boomerang/Cargo.toml

bench-rust-federations: toolchain ## compare federations in Rust with iceoryx2, side by side; needs libclang
	@cargo run --quiet --release --manifest-path bench/iceoryx2/Cargo.toml

bench-python: build $(VENV)/.requirements ## measure the scheduler with Python bodies
	@$(BIN)/python bench/python_bodies.py

bench-in-process: build $(VENV)/.requirements ## compare federates as threads with federates as processes
	@$(BIN)/python bench/in_process.py

bench-in-parallel: build $(VENV)/.requirements ## measure what runs in parallel when Python is the work: workers, threads, processes
	@$(BIN)/python bench/in_parallel.py

bench-frames: toolchain ## count the frames between federates and the RTI
	cargo bench --quiet -p hprm-sim --bench frames

bench-fleet: toolchain agent ## count what a thousand federates on a hundred machines send, and measure the memory of agents
	cargo bench --quiet -p hprm-sim --bench fleet
	@$(BIN)/python bench/agent_links.py

bench-agents: toolchain agent $(VENV)/.requirements ## compare links through agents with TCP and with Zenoh, between network namespaces
	@$(BIN)/python bench/agents.py

bench-grants: toolchain ## measure what a grant costs, with up to a thousand federates
	cargo bench --quiet -p hprm-sim --bench grants

fmt: $(VENV)/.requirements ## format the Rust and the Python code
	cargo fmt --all
	$(BIN)/ruff check --quiet --fix $(PYTHON_CODE)
	$(BIN)/ruff format --quiet $(PYTHON_CODE)

lint: lint-other ## check the format and the lints; nothing is changed
	cargo clippy $(TESTED) --all-targets -- -D warnings

lint-other: $(VENV)/.requirements
	cargo fmt --all --check
	$(BIN)/ruff check $(PYTHON_CODE)
	$(BIN)/ruff format --check $(PYTHON_CODE)
	$(BIN)/mypy
	MYPYPATH=python $(BIN)/mypy --strict --config-file= $(TYPED_PROGRAMS)
	$(BIN)/pyright

# cargo-deny is compiled once, into out/tools. Advisories are the only check that needs the net.
DENY ?= bans licenses sources
deny: out/tools/bin/cargo-deny ## check licenses and origins of all crates; DENY='advisories ...' chooses the checks
	out/tools/bin/cargo-deny --locked $(if $(findstring advisories,$(DENY)),,--offline) check $(DENY)

out/tools/bin/cargo-deny: | toolchain
	cargo install --quiet --locked --root out/tools cargo-deny --version 0.20.2

hooks: $(VENV)/.requirements ## have git check the format before each commit
	$(BIN)/pre-commit install

clean: ## remove everything that the other targets made
	rm -rf $(VENV) out
	cargo clean

# Says what is missing on this machine before a tool fails with something less clear.
toolchain:
	@command -v cargo >/dev/null 2>&1 || { \
	  echo "error: cargo is not on the PATH" >&2; \
	  echo "  hint: install Rust from https://rustup.rs and open a new shell" >&2; exit 1; }
	@command -v $(PY) >/dev/null 2>&1 || { \
	  echo "error: $(PY) is not on the PATH" >&2; \
	  echo "  hint: install Python 3.10 or newer, or name one: make PY=/path/to/python3" >&2; exit 1; }
	@$(PY) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo "error: $(PY) is $$($(PY) --version 2>&1), but Python 3.10 or newer is needed" >&2; \
	  echo "  hint: name another one: make PY=/path/to/python3" >&2; exit 1; }
	@$(PY) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "error: $(PY) cannot make virtual environments" >&2; \
	  echo "  hint: on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }

INSTALL := $(BIN)/python -m pip install --disable-pip-version-check
# uv installs what pip would, in a quarter of the time. Where it does not find the index that pip is told to use, pip installs.
require = $(BIN)/uv pip install --quiet --python $(BIN)/python -r $(1) || $(INSTALL) --quiet -r $(1)

$(VENV)/.build-requirements: requirements-build.txt | toolchain
	$(PY) -m venv $(VENV)
	$(INSTALL) --quiet -r requirements-build.txt
	@touch $@

# What tests, lints and benchmarks need beyond that.
$(VENV)/.requirements: requirements-dev.txt requirements-demo.txt requirements-driving.txt requirements-simulators.txt docs/requirements.txt $(VENV)/.build-requirements
	$(call require,requirements-dev.txt)
	@touch $@

$(VENV)/.demo-requirements: requirements-demo.txt $(VENV)/.build-requirements
	$(call require,requirements-demo.txt)
	@touch $@

$(VENV)/.driving-requirements: requirements-driving.txt $(VENV)/.build-requirements
	$(call require,requirements-driving.txt)
	@touch $@

$(VENV)/.wheel-requirements: requirements-wheel.txt $(VENV)/.build-requirements
	$(call require,requirements-wheel.txt)
	@touch $@

BUILT_FROM := $(VENV)/.build-requirements pyproject.toml $(wildcard packaging/*.py) $(RUST_SOURCES)
BUILD := PATH="$(CURDIR)/$(BIN):$$PATH" $(INSTALL) --verbose --no-build-isolation --no-deps --editable .

# Extension, package and command; pip says nothing of what cargo does unless it is verbose.
$(VENV)/.built: $(BUILT_FROM) | toolchain
	$(if $(wildcard $(VENV)/.whole $(VENV)/.checked),HPRM_WHOLE=1) $(BUILD)
	@rm -f $(VENV)/.checked
	@touch $@

# The same with all features of the command: diagrams, the screen of `hprm top`, simulation, TLS, completions and manual
# pages, and optimized when it is linked. That takes minutes, and the demo shows the same without. Where it has been built
# once, all builds are such.
$(VENV)/.whole: $(BUILT_FROM) | toolchain
	HPRM_WHOLE=1 $(BUILD)
	@rm -f $(VENV)/.checked
	@touch $(VENV)/.built $@

# The same for tests, in cargo's profile for development: it compiles in half the time, shares most of that with the
# tests in Rust, and checks assertions and overflows. One of these builds is in .venv, whose stamp says which.
$(VENV)/.checked: $(BUILT_FROM) | toolchain
	HPRM_WHOLE=1 MATURIN_PEP517_ARGS="--profile dev" $(BUILD)
	@rm -f $(VENV)/.built $(VENV)/.whole
	@touch $@
