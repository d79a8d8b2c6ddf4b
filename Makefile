# Everything a clone needs, typed as one word. `make help` lists the words.
#
# Needs Rust (cargo), Python 3.10 or newer with venv, and make. The rest goes into .venv, out and
# target, all of which git ignores.

PY ?= python3
VENV := .venv
BIN := $(VENV)/bin
TARGET := $(if $(CARGO_TARGET_DIR),$(CARGO_TARGET_DIR),target)

# One interpreter for every compilation of the Python module, so that none undoes another's work.
export PYO3_PYTHON := $(CURDIR)/$(BIN)/python

# How many tests in Python run at a time: they wait more than they compute.
WORKERS ?= 3

PYTHON_CODE := python tests bench examples docs
# Programs that the strictest checks of types must accept, as those of users who run them.
TYPED_PROGRAMS := tests/twins $(filter-out examples/broadcast_gather/%,$(wildcard examples/*/*.py))
RUST_SOURCES := Cargo.toml Cargo.lock \
	$(shell find crates -name '*.rs' -o -name 'Cargo.toml' -o -path '*/explanation/*.md')

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help build demo docs test acceptance check-model sim-nightly conformance bench bench-quick bench-ordering bench-rust bench-rust-federations bench-python bench-in-process mutants bench-frames bench-grants fmt lint clean toolchain

help: ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-16s %s\n", $$1, $$2 }' Makefile

build: $(VENV)/.built ## build the command `hprm` and the Python package into .venv

docs: build ## build the handbook into out/handbook
	$(BIN)/sphinx-build -W --keep-going -q docs out/handbook
	@echo "open out/handbook/index.html"

demo: build ## run the broadcast and gather example, print its table, draw its picture
	@$(BIN)/python examples/broadcast_gather/demo.py

test: lint build ## check format and lints, then run all Rust and Python tests
	cargo test --workspace --exclude hprm-python
	$(BIN)/python -m pytest tests/python -n $(WORKERS) --dist worksteal
	$(BIN)/python tests/mutants/run.py

mutants: $(VENV)/.requirements ## put faults into copies of the coordination; simulation must find all of them
	$(BIN)/python tests/mutants/run.py

check-model: toolchain ## go every way in which small federations can go, for some minutes
	cargo test -p hprm-sim --test model -- --nocapture --include-ignored --test-threads 2

acceptance: build ## the long form of some tests: pauses, orders of starting, equal runs, kills
	HPRM_ACCEPTANCE=1 $(BIN)/python -m pytest tests/python/test_acceptance.py \
		tests/python/test_memory.py tests/python/test_readers.py \
		tests/python/test_random_programs.py

FIRST ?= 0
sim-nightly: toolchain ## a million random federations in a simulated network; FIRST= names the first seed
	cargo run --quiet --release -p hprm-cli -- sim --seed $(FIRST) --seeds 1000000

conformance: build ## run Lingua Franca's own tests; LF= names a checkout of its repository
	@test -n "$(LF)" || { echo "error: which checkout? make conformance LF=path" >&2; exit 1; }
	$(BIN)/python tests/conformance/run.py "$(LF)" --single-threaded

BENCH ?=
bench: build ## compare with all peers side by side, half an hour; BENCH= options; then bench-ordering
	@$(BIN)/python bench/peers/run.py $(BENCH)
	@$(BIN)/python bench/ordering.py

bench-quick: build ## a few minutes of that comparison, to see that everything works
	@$(BIN)/python bench/peers/run.py --quick $(BENCH)

bench-ordering: build ## count messages out of order on a loaded machine, with tags and without
	@$(BIN)/python bench/ordering.py

# Boomerang needs features that its compiler's version still calls unstable.
bench-rust: toolchain ## compare the scheduler with boomerang, both in Rust, side by side
	@RUSTC_BOOTSTRAP=1 cargo run --quiet --release --manifest-path bench/boomerang/Cargo.toml

bench-rust-federations: toolchain ## compare federations in Rust with iceoryx2, side by side; needs libclang
	@cargo run --quiet --release --manifest-path bench/iceoryx2/Cargo.toml

bench-python: build ## measure the scheduler with Python bodies
	@$(BIN)/python bench/python_bodies.py

bench-in-process: build ## compare federates as threads with federates as processes
	@$(BIN)/python bench/in_process.py

bench-frames: toolchain ## count the frames between federates and the RTI
	cargo bench --quiet -p hprm-sim --bench frames

bench-grants: toolchain ## measure what a grant costs, with up to a thousand federates
	cargo bench --quiet -p hprm-sim --bench grants

fmt: $(VENV)/.requirements ## format the Rust and the Python code
	cargo fmt --all
	$(BIN)/ruff check --quiet --fix $(PYTHON_CODE)
	$(BIN)/ruff format --quiet $(PYTHON_CODE)

lint: $(VENV)/.requirements ## check the format and the lints; nothing is changed
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	$(BIN)/ruff check $(PYTHON_CODE)
	$(BIN)/ruff format --check $(PYTHON_CODE)
	$(BIN)/mypy
	MYPYPATH=python $(BIN)/mypy --strict --config-file= $(TYPED_PROGRAMS)
	$(BIN)/pyright

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

$(VENV)/.requirements: requirements-dev.txt docs/requirements.txt | toolchain
	$(PY) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-dev.txt
	@touch $@

# maturin refuses to choose between two environments, so a surrounding conda is hidden from it.
$(VENV)/.built: $(VENV)/.requirements pyproject.toml $(RUST_SOURCES) | toolchain
	env -u CONDA_PREFIX VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/maturin develop --release
	cargo build --release -p hprm-cli
	install -m 755 $(TARGET)/release/hprm $(BIN)/hprm
	@touch $@
