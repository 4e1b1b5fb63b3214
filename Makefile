# One set of targets for people and for CI. `make help` lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DOCS := .venv-docs
ROS2 := .venv-ros2
TORCH := .venv-torch
NODE := .node
STAMP := $(VENV)/.setup-done
RUST := $(shell find crates -name '*.rs' -o -name Cargo.toml) Cargo.toml Cargo.lock rustfmt.toml

export OMP_NUM_THREADS ?= 2
export VIRTUAL_ENV := $(CURDIR)/$(VENV)

.PHONY: help setup demo test test-torch wheel try-wheel lint docs format bench bench-render fuzz clean
.DEFAULT_GOAL := help

help: ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

setup: $(STAMP) ## virtual environment in .venv with the release build: .venv/bin/meshslam

$(VENV)/.packages: requirements.lock
	@command -v cargo >/dev/null || { echo "meshslam builds its core with Rust 1.89 or newer: install it (rustup, or your distribution's cargo)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --requirement requirements.lock
	@touch $@

$(STAMP): $(VENV)/.packages pyproject.toml $(RUST)
	$(BIN)/maturin develop --release --quiet
	@touch $@

demo: setup ## draw a street, map it, find the camera in the map, run SLAM: demo/report.html
	$(BIN)/meshslam demo --out demo --overwrite

$(ROS2)/.packages: requirements-ros2.lock $(VENV)/.packages
	$(PYTHON) -m venv --clear $(ROS2)
	$(ROS2)/bin/pip install --quiet --disable-pip-version-check --no-deps --requirement requirements-ros2.lock
	$(BIN)/python scripts/join_environments.py $(ROS2)
	@touch $@

$(NODE)/.packages: tests/node/package.json
	@mkdir -p $(NODE) && cp tests/node/package.json $(NODE)
	@if command -v npm >/dev/null; then npm install --silent --no-package-lock --no-audit --no-fund --prefix $(NODE); else echo "no npm: tests by other projects' glTF validator are skipped"; fi
	@touch $@

test: setup $(ROS2)/.packages $(NODE)/.packages ## every test; those of the ROS 2 node in .venv-ros2
	$(BIN)/python scripts/test.py

$(TORCH)/.packages: requirements-torch.lock $(VENV)/.packages
	$(PYTHON) -m venv --clear $(TORCH)
	$(TORCH)/bin/pip install --quiet --disable-pip-version-check --no-deps --requirement requirements-torch.lock
	$(BIN)/python scripts/join_environments.py $(TORCH)
	@touch $@

test-torch: setup $(TORCH)/.packages ## the tests that need PyTorch, in .venv-torch (5.3 GB: its wheels hold CUDA)
	$(TORCH)/bin/python -m pytest tests/autodiff tests/examples/test_autodiff.py

wheel: setup ## a wheel for Python 3.11 and newer, and the source distribution, in dist/
	$(BIN)/maturin build --release --quiet --out dist
	$(BIN)/maturin sdist --out dist 2>/dev/null
	@ls -l dist

try-wheel: wheel ## install the wheel in an empty environment, without a compiler, and run the demo there
	$(BIN)/python scripts/try_wheel.py "$$(ls -t dist/*.whl | head -1)"

lint: setup ## formatting, clippy, ruff, mypy, import arrows of both languages, stub against binary: warnings are errors
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --release --quiet -- -D warnings
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python scripts/check_faces.py
	$(BIN)/python scripts/check_core_modules.py
	$(BIN)/python scripts/results_table.py --check
	$(BIN)/python scripts/scale_tables.py --check
	$(BIN)/python -m mypy.stubtest meshslam._core

$(DOCS)/.packages: docs/requirements.txt
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/pip install --quiet --disable-pip-version-check --requirement docs/requirements.txt
	@touch $@

docs: $(DOCS)/.packages ## the site, from docs/ and the docstrings: site/index.html, which opens offline; warnings are errors
	NO_MKDOCS_2_WARNING=1 $(DOCS)/bin/mkdocs build --strict --quiet

format: setup ## format and mend what can be mended
	cargo fmt --all
	$(BIN)/ruff check --fix --quiet .
	$(BIN)/ruff format --quiet .

bench: bench-render ## every benchmark: figures and plots in benchmarks/out

$(VENV)/.bench: $(VENV)/.packages benchmarks/requirements.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --requirement benchmarks/requirements.txt
	@touch $@

bench-render: setup $(VENV)/.bench ## the renderer and its gradients side by side with DEODR and OpenCV
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/render.py

FUZZ_SECONDS ?= 600

fuzz: setup ## hostile input to the core's entry points (with overflow checks), readers, streams and losses: FUZZ_SECONDS (600); FUZZ_SEED repeats a finding
	$(BIN)/python scripts/fuzz_readers.py $$(($(FUZZ_SECONDS) / 4)) $(or $(FUZZ_SEED),0)
	$(BIN)/python scripts/fuzz_streams.py $$(($(FUZZ_SECONDS) / 4)) $(or $(FUZZ_SEED),0)
	$(BIN)/python scripts/fuzz_autodiff.py $$(($(FUZZ_SECONDS) / 4)) $(or $(FUZZ_SEED),0)
	FUZZ_SECONDS=$$(($(FUZZ_SECONDS) / 4)) \
	CARGO_PROFILE_RELEASE_OVERFLOW_CHECKS=true CARGO_PROFILE_RELEASE_DEBUG_ASSERTIONS=true \
	cargo test --release --target-dir target/fuzz --package meshslam-core --test fuzz -- --ignored --nocapture

clean: ## remove what was built
	rm -rf $(VENV) $(DOCS) $(ROS2) $(TORCH) $(NODE) target demo site benchmarks/out
