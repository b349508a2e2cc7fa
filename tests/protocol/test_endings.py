"""Reasons for which runs end: which of them tell of a failure, and of which."""

import pytest

from encircle.protocol.endings import EndReason, failure_of, failure_reason, is_failure


def test_what_a_run_failed_of_is_read_back():
    assert failure_reason("r3 did not join") == "failed: r3 did not join"
    assert failure_of("failed: r3 did not join") == "r3 did not join"
    assert failure_of("failed: failed: twice") == "failed: twice"
    assert is_failure("failed: ")


@pytest.mark.parametrize("reason", [*EndReason, "running", "failed", "not failed: so", ""])
def test_other_reasons_are_no_failures(reason):
    assert failure_of(reason) is None
    assert not is_failure(reason)
