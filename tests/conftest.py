"""What holds for every test: a machine may be slow, or busy with something else."""

import gc
import multiprocessing
import os

import pytest
from helpers_waiting import TIMEOUTS
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

# For the nodes and commands that tests start as processes; their options go before it.
os.environ["ENCIRCLE_JOIN_TIMEOUT"] = f"{TIMEOUTS.join_s_max}"
os.environ["ENCIRCLE_ANSWER_TIMEOUT"] = f"{TIMEOUTS.answer_s_max}"

settings.register_profile(
    "any-machine", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any-machine")
# Hypothesis draws numbers that it finds in the sources of modules that are imported by then: what a
# test is given would depend on the tests before it in its worker, derandomised or not.
assert hasattr(providers, "_get_local_constants"), "another Hypothesis: look where it does that"
providers._get_local_constants = providers.Constants


FORKED = multiprocessing.get_context("forkserver")
FORKED.set_forkserver_preload(["encircle.studies.tasks", "encircle.paper.reproduce"])


@pytest.fixture(autouse=True)
def forked_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers of a pool that a test itself uses are forked from a process that has imported all.

    Those of commands are fresh interpreters, as ever.
    """
    monkeypatch.setattr("encircle.runner.process_pool.get_context", lambda _method: FORKED)


def pytest_collection_finish() -> None:
    """Thousands of tests and what they import stay: the garbage collector need not visit them."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def timeouts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same for hunts and studies that a test runs itself."""
    monkeypatch.setattr("encircle.runner.launch.TIMEOUTS", TIMEOUTS)
