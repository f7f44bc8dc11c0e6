# make demo: the whole loop on a real glider log.  make docs: the documentation.  make test: all checks.  All make .venv and install by themselves.

VENV := .venv
BIN := $(VENV)/bin
DEMO_OUT := demo-output

# The first Python of a supported version on the path; name another with `make PYTHON=/path/to/python3.12 ...`.
SUPPORTED := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	command -v $$p >/dev/null 2>&1 && $$p -c '$(SUPPORTED)' 2>/dev/null && echo $$p && break; done)

# Tests run in a process for each core: linear algebra with threads of its own would make them wait for one another.
test test-slow: export OPENBLAS_NUM_THREADS := 1

PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input -qq
# pip would write bytecode on one core, and that of the packages' own tests, too; what is no Python 3 does not compile.
# Large packages of which little is imported are left to those that import it.
SELDOM := /tests?/|/dialects/|/torch/(_inductor|_dynamo|testing|onnx|distributed)/|/(sympy|networkx|pip|setuptools|debugpy)/
INSTALL := $(PIP) install --no-compile -c constraints.txt
BYTECODE := $(BIN)/python -m compileall -qq -j 0 -x '$(SELDOM)' $(VENV)/lib || true
PACKAGES := auv_gym controllers identification scripts

.PHONY: demo docs test test-slow lint format install slocum-cache clean
.DEFAULT_GOAL := test

demo: $(VENV)/.installed-demo
	$(BIN)/auv-gym diagnose slocum:ammonite --vehicle slocum --min-depth 10 --out $(DEMO_OUT)
	@echo "The report: $(CURDIR)/$(DEMO_OUT)/report.html"

# Many tests start a process of their own, which would read all sources anew: bytecode is written before.
test: lint $(VENV)/.slocum-cache
	@$(BIN)/python -m compileall -qq -j 0 $(PACKAGES)
	$(BIN)/python -m tests.warm_cache
	$(BIN)/python -m pytest

test-slow: $(VENV)/.installed-dev $(VENV)/.slocum-cache
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/.installed-dev
	$(BIN)/ruff format --check || { echo "Run: make format" >&2; exit 1; }
	$(BIN)/ruff check --quiet
	$(BIN)/lint-imports
	$(BIN)/ty check --quiet --python $(BIN)/python

# Nothing is fetched, neither here nor by who reads it. Searching needs a server: python3 -m http.server -d site
docs: $(VENV)/.installed-dev
	$(BIN)/python -m scripts.site_pages
	$(BIN)/zensical build --clean --strict
	@echo "The documentation: $(CURDIR)/site/index.html"

format: $(VENV)/.installed-dev
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

install: $(VENV)/.installed-dev

# Newer Slocum logs name their sensors in cache files. dbdreader ships those of its own logs (amadeus, sebastian) in the
# source archive only; this puts them where its wheel would have them.
slocum-cache: $(VENV)/.slocum-cache

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "auv-gym needs Python 3.11 to 3.14, found $$(python3 --version 2>/dev/null || echo none):" \
		"install one of them, or name it: make PYTHON=/path/to/python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@"$(PYTHON)" -c '$(SUPPORTED)' || { echo "auv-gym needs Python 3.11 to 3.14, got $$("$(PYTHON)" --version 2>&1):" \
		"name another: make PYTHON=/path/to/python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@echo "Making $(VENV) with $$("$(PYTHON)" --version 2>&1)"
	@"$(PYTHON)" -m venv $(VENV) || { rm -rf $(VENV); exit 1; }

$(VENV)/.installed-demo: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing auv-gym and what the demo needs; this takes a minute or two the first time"
	@$(INSTALL) -e '.[render,slocum]'
	@$(BYTECODE)
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing auv-gym with its development tools; this takes a minute or two the first time"
	@$(INSTALL) -e '.[dev]'
	@$(BYTECODE)
	@touch $@ $(VENV)/.installed-demo

$(VENV)/.slocum-cache: $(VENV)/.installed-dev
	@echo "Fetching the cache files of dbdreader's own logs"
	@archive=$$(mktemp -d) && trap 'rm -rf "$$archive"' EXIT && \
	version=$$($(BIN)/python -c 'from importlib.metadata import version; print(version("dbdreader"))') && \
	data=$$($(BIN)/python -c 'from importlib.util import find_spec; print(find_spec("dbdreader").submodule_search_locations[0])')/data && \
	$(PIP) download --no-deps --no-binary dbdreader "dbdreader==$$version" -d "$$archive" && \
	tar -xzf "$$archive/dbdreader-$$version.tar.gz" -C "$$archive" && \
	cp -R "$$archive/dbdreader-$$version/dbdreader/data/cac" "$$data/" || \
	echo "They could not be fetched: the tests that read amadeus and sebastian will be skipped"
	@touch $@

clean:
	rm -rf $(VENV) $(DEMO_OUT) .pytest_cache .ruff_cache .import_linter_cache .hypothesis build dist site
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
