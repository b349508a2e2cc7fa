# make setup        one virtual environment, everything pinned
# make hunt         set up, then four robot processes and a world hunt a target over Zenoh
# make test         set up, then the tests; make test ARGS=--lf: only those that failed
# make test-pythons the tests with each Python that is at hand, or with PYTHONS="..."
# make coverage     the tests, and how much of each room they run
# make test-loaded  the same while all cores are busy otherwise
# make nightly      many more seeds, hosts where it can, and the tests under load: some hours
# make hosts        hunts over network namespaces, a host each; as root
# make pages        the page in a real browser; installs Debian's if there is none, as root
# make containers   hunts in containers on a real engine; as root on Debian, installs what it needs
# make format       style, where a program can see to it
# make check        style, types and import contracts
# make docs         the pages as a site, in build/site; a broken link fails it
# make bench        the speeds that the README quotes
# make bench-check  measures them anew and names what is slower than on record; some minutes, nightly

PYTHON ?= python3
VENV ?= .venv
# For make test-pythons, which passes over those that are not there.
PYTHONS ?= python3.11 python3.12 python3.13
# Arguments for pytest.
ARGS ?=
BENCH_VENV := .venv-bench
READY := $(VENV)/.ready
PYTEST = $(VENV)/bin/python -m pytest
# Pytest's status 5, no test selected, is none of a failure: a half may have none of those asked for.
OR_NONE = || [ $$? -eq 5 ]
# A signal in a process's first moment meets coverage there, which starts before any line of ours.
MEASURED = --deselect tests/system/test_interrupts.py::test_in_the_first_moment_it_is_one_line \
  --deselect tests/system/test_interrupts.py::test_at_any_time_it_ends_with_a_line_and_leaves_nothing
REALTIME = -n 0 -m 'realtime and not nightly and not hosts'
# Tests start hundreds of processes. Each would compile what it imports, if bytecode were not kept.
export PYTHONDONTWRITEBYTECODE :=
# A test that takes longer hangs, however slow and busy the machine is.
HANG_S := 7200

.PHONY: setup hunt test test-pythons test-loaded nightly hosts pages containers format check coverage docs bench bench-check clean

setup: $(READY)

$(READY): requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or newer is needed, $(PYTHON) is $$($(PYTHON) --version 2>&1); try make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --requirement requirements.txt
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $(READY)

hunt: setup
	$(VENV)/bin/encircle run sim1

# What goes by the clock comes last, one test at a time, with nothing of ours beside it.
test: setup
	$(PYTEST) $(ARGS) $(OR_NONE)
	$(PYTEST) $(REALTIME) $(ARGS) $(OR_NONE)

# An environment for each interpreter; the first one that fails ends it.
test-pythons:
	@for python in $(PYTHONS); do \
	  if command -v $$python > /dev/null; then \
	    echo "with $$($$python --version)"; \
	    $(MAKE) test PYTHON=$$python VENV=.venv-$$(basename $$python) || exit 1; \
	  else \
	    echo "$$python is not here: passed over"; \
	  fi; \
	done

test-loaded: setup
	PYTEST_TIMEOUT=$(HANG_S) $(VENV)/bin/python tests/helpers/processes/under_load.py $(MAKE) test

nightly: setup
	PYTEST_TIMEOUT=$(HANG_S) $(PYTEST) -m 'nightly or hosts'
	$(MAKE) test-loaded
	$(MAKE) bench-check

hosts: setup
	@command -v ip > /dev/null || apt-get install --yes --no-install-recommends iproute2
	$(PYTEST) -m hosts

pages: setup
	@command -v chromium > /dev/null || apt-get install --yes --no-install-recommends chromium
	ENCIRCLE_BROWSER=yes $(PYTEST) -n 0 -m browser -rP

containers: setup
	ENCIRCLE_CONTAINERS=yes $(PYTEST) tests/system/containers -n 0 -rP --durations=0

format: setup
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .

check: setup
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

# Every process counts: those of tests, of hunts, and forked nodes. Figures come also after a failure.
coverage: setup
	rm -f .coverage .coverage.*
	@failed=0; \
	$(VENV)/bin/coverage run -m pytest $(MEASURED) $(ARGS) $(OR_NONE) || failed=1; \
	$(VENV)/bin/coverage run -m pytest $(REALTIME) $(ARGS) $(OR_NONE) || failed=1; \
	$(VENV)/bin/coverage combine --quiet && $(VENV)/bin/python tests/helpers/coverage_by_room.py || failed=1; \
	exit $$failed

docs: setup
	$(VENV)/bin/sphinx-build --quiet --fail-on-warning --keep-going --builder html docs build/site
	@echo "build/site/index.html"

# The programs compared with live in an environment of their own.
$(BENCH_VENV)/.ready: bench/requirements.txt
	$(PYTHON) -m venv $(BENCH_VENV)
	$(BENCH_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --requirement bench/requirements.txt
	@touch $@

bench: setup $(BENCH_VENV)/.ready
	$(VENV)/bin/python bench/run.py --peers $(BENCH_VENV)/bin/python

bench-check: setup $(BENCH_VENV)/.ready
	@mkdir -p build
	$(VENV)/bin/python bench/run.py --peers $(BENCH_VENV)/bin/python --json build/bench.json
	$(VENV)/bin/python bench/check.py build/bench.json

clean:
	rm -rf .venv .venv-* .coverage .coverage.*
