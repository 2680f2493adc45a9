# One word for each thing to do; `make help` lists them.
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CODE := orthomill schemas tasks pipeline tests benchmarks
project ?= volos
photos ?=
options ?=

.DEFAULT_GOAL := help
.PHONY: help setup run plan status report export watch dashboard doctor test test-fast test-slow fuzz lint types format bench bench-rtk-flight bench-time bench-tile-map bench-map-cost bench-remaining-time bench-brighton bench-orientation bench-matching bench-window-sizes bench-matching-speed bench-calibration bench-orientation-simulated bench-adjustment bench-orthoimage bench-camera-constants bench-registration bench-published-bundles bench-layouts bench-flights bench-growth bench-vll bench-guided bench-guide compare chaos docs clean clean-all bench-texture bench-meshes

help: ## List all targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1|/' | awk -F'|' '{printf "  %-18s %s\n", $$1, $$2}'

$(STAMP): requirements.lock pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	@$(BIN)/python -c "import sys; assert sys.version_info >= (3, 11), 'orthomill needs Python 3.11 or newer'"
	@touch $(STAMP)

setup: $(STAMP) ## Install everything into .venv (done by the other targets when needed)

run: $(STAMP) ## Run a project: make project=volos run (options="--until orientation"; photos=FOLDER begins a new one)
	@if [ -n "$(photos)" ] && [ ! -f "workflows/$(project).yaml" ]; then $(BIN)/orthomill init "$(project)" --photos "$(photos)"; fi
	@$(BIN)/orthomill run $(project) $(options)

plan: $(STAMP) ## Show jobs, bytes, peak memory and why each stage would run
	@$(BIN)/orthomill plan $(project) $(options)

status: $(STAMP) ## Show what is done, what failed and why
	@$(BIN)/orthomill status $(project)

report: $(STAMP) ## Write the report again from what is there
	@$(BIN)/orthomill report $(project)

export: $(STAMP) ## Write the products again
	@$(BIN)/orthomill export $(project) $(options)

watch: $(STAMP) ## Open the map of tiles of a run, while it goes on or afterwards
	@$(BIN)/orthomill watch $(project)

dashboard: $(STAMP) ## Print the address of the dashboard of a run that is going on
	@$(BIN)/orthomill dashboard $(project)

doctor: $(STAMP) ## Examine this machine
	@$(BIN)/orthomill doctor

test: $(STAMP) ## Run all tests, on two processes
	@$(BIN)/python -m pytest -n 2 --dist loadfile

test-fast: $(STAMP) ## Run the tests that take seconds
	@$(BIN)/python -m pytest -m "not slow"

test-slow: $(STAMP) ## Run the tests that take minutes
	@$(BIN)/python -m pytest -m slow

fuzz: $(STAMP) ## Give every reader of files, and the command, thousands of broken ones (options=5000: cases for each)
	@ORTHOMILL_FUZZ=$(or $(options),3000) $(BIN)/python -m pytest tests/failures/test_fuzzed_files.py tests/failures/test_fuzzed_commands.py

lint: $(STAMP) types ## Check style, format and types
	@$(BIN)/ruff check $(CODE)
	@$(BIN)/ruff format --check --quiet $(CODE) || (echo "run 'make format'"; exit 1)

types: $(STAMP) ## Check types
	@$(BIN)/mypy -p orthomill

format: $(STAMP) ## Format the code and mend what the linter can mend
	@$(BIN)/ruff check --fix $(CODE)
	@$(BIN)/ruff format $(CODE)

bench: $(STAMP) ## Measure the figures in benchmarks/results
	@$(BIN)/python -m benchmarks

bench-orientation: $(STAMP) ## Orientation of real photographs, beside COLMAP where it is installed
	@$(BIN)/python -m benchmarks.orientation.orientation_real

bench-rtk-flight: $(STAMP) ## A public RTK flight with defaults: is its floor flat, do its tags fit (options="FOLDER --surface")
	@$(BIN)/python -m benchmarks.orientation.rtk_flight $(options)

bench-time: $(STAMP) ## Where the time goes, stage by stage (options="runs/volos ..." for runs that are finished)
	@$(BIN)/python -m benchmarks.time_by_stage $(options)

bench-tile-map: $(STAMP) ## What the map of a million tiles costs the scheduler and a browser (needs Playwright and a Chromium)
	@$(BIN)/python -m benchmarks.watching.tile_map $(options)

bench-map-cost: $(STAMP) ## What the map of tiles costs a finished run: make project=volos bench-map-cost
	@$(BIN)/python -m benchmarks.watching.map_cost $(project)

bench-remaining-time: $(STAMP) ## Estimates of the remaining time beside what came, in recorded runs
	@$(BIN)/python -m benchmarks.watching.remaining_time $(options)

bench-brighton: $(STAMP) ## The drone block by code, beside a peer, and disjoint strips (options="runs/brighton")
	@$(BIN)/python -m benchmarks.brighton $(options)

bench-matching: $(STAMP) ## Measure matching beside the published experiments (options="--quick")
	@$(BIN)/python -m benchmarks.matching.published_tables $(options)

bench-window-sizes: $(STAMP) ## Measure what choosing a matching window costs
	@$(BIN)/python -m benchmarks.matching.window_sizes

bench-matching-speed: $(STAMP) ## Measure the points per second of least-squares matching
	@$(BIN)/python -m benchmarks matching_speed

compare: $(STAMP) ## All ways to heights side by side: docs/compare.md (options="runs/volos runs/brighton")
	@$(BIN)/python -m benchmarks.compare.compare_methods $(options)

bench-guided: $(STAMP) ## Guided densification beside its published figures (options=runs/volos)
	@$(BIN)/python -m benchmarks.compare.guided_study $(options)

bench-guide: $(STAMP) ## What an existing height model brings to every way to heights (options=runs/brighton)
	@$(BIN)/python -m benchmarks.compare.guide_study $(options)

bench-vll: $(STAMP) ## Vertical line locus beside its published study
	@$(BIN)/python -m benchmarks.vll.line_locus_study

bench-calibration: $(STAMP) ## Measure the calibration beside OpenCV: many seeds, rendered and real photographs
	@$(BIN)/python -m benchmarks.calibration.calibration_accuracy

bench-orthoimage: $(STAMP) ## The orthoimage of a run beside orthority (options="runs/volos PYTHON")
	@$(BIN)/python -m benchmarks.orthoimage_peers $(options)

bench-texture: $(STAMP) ## Solid surfaces: kernels beside ray casting, remedies of occlusion limits
	@$(BIN)/python -m benchmarks.texture.texture_acceptance

bench-meshes: $(STAMP) ## Photographs and meshes of other programs, every photograph left out (options="FOLDER ...")
	@$(BIN)/python -m benchmarks.texture.foreign_meshes $(options)

bench-camera-constants: $(STAMP) ## Camera constants that real blocks find, with their standard errors, beside references
	@$(BIN)/python -m benchmarks.orientation.camera_constants

bench-published-bundles: $(STAMP) ## Self-calibration on the geometry of three published applications
	@$(BIN)/python -m benchmarks.orientation.published_bundles

bench-layouts: $(STAMP) ## Sixty layouts of photographs with planted blunders: what converges, what is named
	@$(BIN)/python -m benchmarks.orientation.planted_layouts $(options)

bench-flights: $(STAMP) ## Simulated flights with wrong cameras and all kinds of positions: bends, stated and named (options="--quick")
	@$(BIN)/python -m benchmarks.flights.simulated_flights $(options)

bench-registration: $(STAMP) ## Joint registration of simulated scans: precision that is true
	@$(BIN)/python -m benchmarks.orientation.scan_registration

bench-orientation-simulated: $(STAMP) ## Orientation on simulated measurements: precision that is true
	@$(BIN)/python -m benchmarks.orientation.orientation_simulated

bench-growth: $(STAMP) ## From files to a block with 100, 300 and 1000 rendered photographs (options="folder=FOLDER 100 300")
	@$(BIN)/python -m benchmarks.orientation.growth.run_growth $(options)

bench-adjustment: $(STAMP) ## Growth of the adjustment up to 1000 photographs (options="against=CHECKOUT")
	@$(BIN)/python -m benchmarks.orientation.adjustment_growth $(options)

chaos: $(STAMP) ## Kill runs in every way, damage stores, compare bit for bit (options="--kills 100 --damages 200 --seed 0")
	@$(BIN)/python -m benchmarks.trust.chaos $(options)

docs: $(STAMP) ## Write the generated pages of docs/ and the documentation site to .cache/site
	@$(BIN)/orthomill reference
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-docs.lock
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict && echo ".cache/site/index.html"

clean: $(STAMP) ## Remove the results of a project
	@$(BIN)/orthomill clean $(project)

clean-all: ## Remove all results and the installed environment
	rm -rf runs $(VENV) .cache
