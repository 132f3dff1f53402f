# Two commands: `make demo` (the main job, its picture in out/demo) and `make test` (the whole suite).
# Everything goes into .venv, installed from the lock file; a second make does not reinstall.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test docs benchmark lock clean

demo: $(STAMP)
	$(BIN)/steer-by-wire demo --out out/demo

# Four processes for two cores, since many tests wait for programs. These are started by the hundred,
# so that what Python compiles is kept, also where the environment says otherwise.
test: $(STAMP)
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 4 --dist loadfile

# The site, in docs/_build; a warning is an error. -a: every page lists all others beside it.
docs: $(STAMP)
	$(BIN)/python -m sphinx -q -a -n -W --keep-going docs docs/_build

benchmark: $(STAMP)
	$(BIN)/python -m pytest benchmarks

$(STAMP): requirements.lock pyproject.toml setup.py
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "needs Python 3.11 or newer: make PYTHON=python3.12")'
	@echo 'Installing into $(VENV), once; this takes a few minutes.'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

LOCKED_EXTRAS := all dev

# Rewrites the lock from the ranges in pyproject.toml (needs uv on the path).
lock:
	uv pip compile --universal --python-version 3.11 $(addprefix --extra ,$(LOCKED_EXTRAS)) --no-header --no-annotate \
	    --no-emit-index-url --no-emit-find-links --generate-hashes --quiet --output-file requirements.lock pyproject.toml

clean:
	rm -rf $(VENV) out docs/_build docs/gallery docs/generated examples/out build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
