# make setup        one virtual environment, everything pinned
# make hunt         set up, then four robot processes and a world hunt a target over Zenoh
# make test         set up, then the tests
# make test-loaded  the same while all cores are busy otherwise
# make nightly      many more seeds, hosts where it can, and the tests under load: some hours
# make hosts        hunts over network namespaces, a host each; as root
# make containers   hunts in containers on a real engine; as root on Debian, installs what it needs
# make check        style, types and import contracts
# make bench        the speeds that the README quotes

PYTHON ?= python3
VENV := .venv
BENCH_VENV := .venv-bench
READY := $(VENV)/.ready
# A test that takes longer hangs, however slow and busy the machine is.
HANG_S := 7200

.PHONY: setup hunt test test-loaded nightly hosts containers check bench clean

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
	$(VENV)/bin/python -m pytest
	$(VENV)/bin/python -m pytest -n 0 -m 'realtime and not nightly and not hosts'

test-loaded: setup
	PYTEST_TIMEOUT=$(HANG_S) $(VENV)/bin/python tests/helpers/processes/under_load.py $(MAKE) test

nightly: setup
	PYTEST_TIMEOUT=$(HANG_S) $(VENV)/bin/python -m pytest -m 'nightly or hosts'
	$(MAKE) test-loaded

hosts: setup
	@command -v ip > /dev/null || apt-get install --yes --no-install-recommends iproute2
	$(VENV)/bin/python -m pytest -m hosts

containers: setup
	ENCIRCLE_CONTAINERS=yes $(VENV)/bin/python -m pytest tests/system/containers -n 0 -rP --durations=0

check: setup
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

# The programs compared with live in an environment of their own.
$(BENCH_VENV)/.ready: bench/requirements.txt
	$(PYTHON) -m venv $(BENCH_VENV)
	$(BENCH_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --requirement bench/requirements.txt
	@touch $@

bench: setup $(BENCH_VENV)/.ready
	$(VENV)/bin/python bench/run.py --peers $(BENCH_VENV)/bin/python

clean:
	rm -rf $(VENV) $(BENCH_VENV)
