"""What Zenoh itself refused, counted: connections and messages that never reach a program.

Zenoh drops what access control forbids, and closes what fails to show a certificate, without
telling the program it is part of; its packages for Python are built without statistics. It does
write each case to its log, on standard output. So a gate that is asked to counts them there: the
log goes into a pipe instead, and what the program itself prints goes where it always went.

A refused connection costs a line; with access control there is a line for every message, refused or
not, which is why counting has to be asked for. The wording of the lines is Zenoh's own and may
change: ``tests/protocol/zenoh/test_access_control.py`` says whether it still is as expected.
"""

import contextlib
import os
import re
import sys
import threading
from collections import Counter
from collections.abc import Iterable, Iterator

from encircle.protocol.process.log import say_error

LOG = "off,zenoh_link_tls=warn,zenoh::net::routing::interceptor::access_control=trace"
"""What Zenoh is to write to its log, in the form of the environment variable ``RUST_LOG``."""
KNOWN_MAX = 4096
"""How many sessions, and cases, are told apart: a stranger may open as many as it likes."""
CAUSES = {
    "peer sent no certificates": "no-certificate",
    "certificate expired": "expired",
    "CertExpired": "expired",
    "UnknownIssuer": "unknown-authority",
    "BadSignature": "unknown-authority",
}
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_REFUSED = re.compile(
    r" (?P<thread>\S+ ThreadId\(\d+\)) \S*access_control: (?:Using cached result: )?"
    r"(?P<session>[0-9a-f]{1,32})(?: on (?P<subject>\S+))? is unauthorized to"
    r" (?P<what>[\w/ ]+) \(ingress\) on "
)
_PREPARING = re.compile(r" (\S+ ThreadId\(\d+\)) \S*access_control: ACL \((?:in|e)gress\): caching")
_CERTIFICATE = re.compile(r"CertCommonName\(([^)]*)\)")
_TELLING = ("unauthorized", "caching", "Declare Liveliness Subscriber")
_CACHED, _LAST_PREPARED = "Using cached result: ", " to Declare Liveliness Subscriber ("


class Refusals:
    """Counts of what was refused.

    ``connections``: by cause, ``no-certificate``, ``unknown-authority``, ``expired`` or ``other``.
    ``messages``: by who sent them (a certificate's common name) and what they were, as ``put``.
    """

    def __init__(self) -> None:
        self.connections: Counter[str] = Counter()
        self.messages: Counter[tuple[str, str]] = Counter()
        self._names: dict[str, str] = {}
        self._preparing: set[str] = set()

    def __str__(self) -> str:
        parts = [f"{n} connections: {cause}" for cause, n in sorted(self.connections.items())]
        parts += [f"{n} times {what} by {who}" for (who, what), n in sorted(self.messages.items())]
        return "; ".join(parts) or "nothing"

    def take_all(self, lines: Iterable[str]) -> "Refusals":
        """Count in a whole log; returns itself."""
        for line in lines:
            self.take(line)
        return self

    def take(self, line: str) -> None:
        """Count one line of the log, if it tells of a refusal."""
        if "access_control" in line:
            self._take_message(line)
        elif "zenoh_link_tls" in line and "WARN" in line:
            causes = (cause for phrase, cause in CAUSES.items() if phrase in line)
            self.connections[next(causes, "other")] += 1

    def _take_message(self, line: str) -> None:
        if not any(word in line for word in _TELLING):
            return
        line = _COLOUR.sub("", line)
        preparing = _PREPARING.search(line)
        if preparing is not None:
            self._preparing.add(preparing[1])
            return
        match = _REFUSED.search(line)
        if match is not None:
            if match["subject"]:
                self._name(match["session"], match["subject"])
            if _CACHED in line or match["thread"] not in self._preparing:
                who = self._names.get(match["session"], "somebody")
                case = who, match["what"].lower()
                if case in self.messages or len(self.messages) < KNOWN_MAX:
                    self.messages[case] += 1
        # A new key is first looked up for every kind of message, in one go, on one thread.
        if _LAST_PREPARED in line and _CACHED not in line:
            self._preparing.difference_update([t for t in self._preparing if f" {t} " in line])

    def _name(self, session: str, subject: str) -> None:
        if len(self._names) >= KNOWN_MAX:
            self._names.clear()
        certificate = _CERTIFICATE.search(subject)
        self._names[session] = certificate[1] if certificate else "somebody"


@contextlib.contextmanager
def counting_refusals() -> Iterator[Refusals]:
    """Count as long as this lasts; to be entered before this process opens its first session."""
    refusals = Refusals()
    os.environ["RUST_LOG"] = LOG
    sys.stdout.flush()
    before = sys.stdout
    reading, writing = os.pipe()
    with (
        os.fdopen(os.dup(1), "w", buffering=1) as printed,
        os.fdopen(reading, errors="replace") as log,
    ):
        os.dup2(writing, 1)
        os.close(writing)
        reader = threading.Thread(target=refusals.take_all, args=(log,), daemon=True)
        reader.start()
        sys.stdout = printed
        try:
            yield refusals
        finally:
            sys.stdout = before
            # With this the pipe's last writing end is gone, and the reader comes to an end.
            os.dup2(printed.fileno(), 1)
            reader.join()


@contextlib.contextmanager
def report_refusals(node: str, counts: bool) -> Iterator[None]:
    """As ``counted``, if asked for, with a line on standard error at the end."""
    if not counts:
        yield
        return
    with counting_refusals() as refusals:
        yield
    say_error(f"{node}: refused: {refusals}")
