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
only ?=

.DEFAULT_GOAL := help
.PHONY: help setup run plan status report export watch dashboard doctor test test-fast test-slow test-times fuzz lint types format bench bench-stale docs clean clean-all

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

# Whole files, so that what a file makes is made once; in the order of tests/conftest.py.
PROCESSES := -n 2 --dist loadfile --no-loadscope-reorder

# In a fresh clone each process would rewrite the asserts of 500 files so that they show values, for longer than half a minute: only
# those that fail do, once more.
test: $(STAMP) ## Run all tests, on two processes
	@$(BIN)/python -m pytest $(PROCESSES) --assert=plain || { $(BIN)/python -m pytest --last-failed --last-failed-no-failures=none; exit 1; }

# The walls first: they answer in seconds, while two processes look for the other tests for longer than that.
test-fast: $(STAMP) ## Run the cheapest tests, on two processes
	@$(BIN)/python -m pytest -q tests/test_architecture.py
	@$(BIN)/python -m pytest -m "not slow" --ignore=tests/test_architecture.py $(PROCESSES)

test-times: $(STAMP) ## Run all tests (options: some) and write which are left out by test-fast, by what they take
	@rm -f .cache/test_times
	@mkdir -p .cache
	@ORTHOMILL_TEST_TIMES=$(CURDIR)/.cache/test_times $(BIN)/python -m pytest $(PROCESSES) $(options) || true
	@$(BIN)/python tests/support/engine/measured_tests.py .cache/test_times $(if $(options),some)

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

bench: $(STAMP) ## What can be measured; only=volos,matching measures these (options="runs/volos" for one of them)
	@$(BIN)/python -m benchmarks $(only) $(if $(options),-- $(options))

bench-stale: $(STAMP) ## Pages of results that are older than the code that they measure
	@$(BIN)/python -m benchmarks stale

docs: $(STAMP) ## Write the generated pages of docs/ and the documentation site to .cache/site
	@$(BIN)/orthomill reference docs/settings.md
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-docs.lock
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict && echo ".cache/site/index.html"

clean: $(STAMP) ## Remove the results of a project
	@$(BIN)/orthomill clean $(project)

clean-all: ## Remove all results and the installed environment
	rm -rf runs $(VENV) .cache
