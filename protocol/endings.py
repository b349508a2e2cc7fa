"""Why a run has ended: captured, out of ticks, or failed for a cause that the reason names.

A reason is text on the wire and in ``summary.json``. Whether it tells of a failure is asked here.
"""

from enum import StrEnum
from typing import Annotated, Any, TypeAlias

from encircle.protocol.wire.checks import text
from encircle.protocol.wire.field_types import FieldType
from encircle.protocol.wire.limits import REASON_MAX

_FAILED_PREFIX = "failed: "


class EndReason(StrEnum):
    """Why a run has ended that did not fail."""

    CAPTURED = "captured"
    TICKS = "ticks"


_REASONS = frozenset(reason.value for reason in EndReason)


def failure_reason(cause: str) -> str:
    """The reason for which a run has ended that failed because of ``cause``."""
    return f"{_FAILED_PREFIX}{cause}"


def failure_of(reason: str) -> str | None:
    """Why a run failed, by the reason for which it ended; None if it did not fail."""
    return reason.removeprefix(_FAILED_PREFIX) if reason.startswith(_FAILED_PREFIX) else None


def is_failure(reason: str) -> bool:
    """Whether a run that ended for this reason has failed."""
    return reason.startswith(_FAILED_PREFIX)


def _check(value: Any) -> str:
    reason = text(value)
    if reason in _REASONS or (reason.startswith(_FAILED_PREFIX) and len(reason) <= REASON_MAX):
        return reason
    raise ValueError(
        f"{', '.join(EndReason)}, or {_FAILED_PREFIX!r} and why, {REASON_MAX} characters in all"
    )


Reason: TypeAlias = Annotated[
    str, FieldType("text", "texts", {"type": "string", "maxLength": REASON_MAX}, _check)
]
