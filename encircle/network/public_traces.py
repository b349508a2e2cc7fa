"""Traces of others: public trace sets, read as traces that the channel can replay.

No data is shipped: their licences allow it only under their own terms. Two forms are read.

*orbit*: links of the ORBIT testbed (Kaul, Gruteser, Seskar 2006; CRAWDAD rutgers/noise, 2007). A
file has a line for each packet that was received, its number and its signal strength, ascending
from 0; a sender sent 300 or 301 packets, one each 0.1 s. What is missing was lost, and a file
without lines is a link that lost all. A strength of 128 or more says that it could not be read, not
that the packet was lost. A folder of one noise level has a folder ``Results_nodeR-C_...`` for each
sender and in it a file ``sdecR-C`` for each receiver. There are no delays.

*uma*: round trips of networked robots (Fernández-Madrigal et al. 2025, doi
10.5281/zenodo.14967644). A file has a line for each round trip, its time in ms. Half of it is taken
as the delay one way. Nothing is lost: what did not come back is not in the file, or is very late.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from encircle.network.tracing import DELAY_DIGITS, NetworkTrace, TraceFileError, TraceRow
from encircle.world.loading.channel_consistency import TRACE_ROWS_MAX
from encircle.world.scenario.fields import DELAY_S_MAX, ROBOTS_MAX, shown

ORBIT_PACKETS = 300
ORBIT_NUMBER_MAX = 9_999
ORBIT_STRENGTH_MAX = 255
ORBIT_LINE = re.compile(r"\s*(\d{1,9})\s+(\d{1,9})\s*", re.ASCII)
ORBIT_SENDER = re.compile(r"Results_node(\d+-\d+)_.*", re.ASCII)
ORBIT_RECEIVER = re.compile(r"sdec(\d+-\d+)", re.ASCII)
NO_DELAYS = "the set has no delays"
MS_PER_S = 1e3


def read_orbit(path: Path, nodes: Sequence[str] = ()) -> NetworkTrace:
    """The trace of a link's file, for all links, or of a noise level's folder.

    ``nodes``: of a folder, which nodes are r1, r2, ..., as in ``1-2``; by default all, by row and
    column. Raises ``TraceFileError`` naming file, line and value, or the link that is missing.
    """
    if not path.is_dir():
        if nodes:
            raise TraceFileError(f"{path}: nodes can be chosen of a folder only, this is a file")
        losses = _orbit_losses(path)
        kept = [TraceRow("", "", lost, None) for lost in losses[:TRACE_ROWS_MAX]]
        return NetworkTrace(kept, NO_DELAYS, len(losses) - len(kept))
    files = _orbit_files(path)
    known = sorted({node for link in files for node in link}, key=_row_and_column)
    chosen = list(nodes) or known
    _check_nodes(path, chosen, known)
    pairs = [(s, r) for s in range(len(chosen)) for r in range(len(chosen)) if s != r]
    rows_per_link_max = TRACE_ROWS_MAX // len(pairs)
    rows: list[TraceRow] = []
    left_out = 0
    for s, r in pairs:
        if (link := (chosen[s], chosen[r])) not in files:
            raise TraceFileError(
                f"{path}: has no file of the link from node {link[0]} to {link[1]}"
            )
        losses = _orbit_losses(files[link])
        left_out += max(0, len(losses) - rows_per_link_max)
        rows += [
            TraceRow(f"r{s + 1}", f"r{r + 1}", lost, None) for lost in losses[:rows_per_link_max]
        ]
    return NetworkTrace(rows, NO_DELAYS, left_out)


def read_uma(path: Path, nodes: Sequence[str] = ()) -> NetworkTrace:
    """The trace of a file of round trips; raises ``TraceFileError`` naming file, line and value."""
    if nodes:
        raise TraceFileError(f"{path}: nodes can be chosen of the format orbit only")
    rows: list[TraceRow] = []
    left_out = 0
    for number, line in _lines(path):
        delay_s = _half_s(path, number, line)
        if len(rows) < TRACE_ROWS_MAX:
            rows.append(TraceRow("", "", 0, round(delay_s, DELAY_DIGITS)))
        else:
            left_out += 1
    if not rows:
        raise TraceFileError(f"{path}: has no round trips")
    return NetworkTrace(rows, None, left_out)


FORMATS: Mapping[str, Callable[[Path, Sequence[str]], NetworkTrace]] = {
    "orbit": read_orbit,
    "uma": read_uma,
}
"""What is read of each format, by name."""


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """A file's lines that are not blank, with their numbers from 1."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                if line.strip():
                    yield number, line.strip()
    except OSError as error:
        raise TraceFileError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TraceFileError(f"{path} cannot be read: it is not text in UTF-8") from None


def _refused(path: Path, number: int, line: str, must: str) -> TraceFileError:
    return TraceFileError(f"{path}, line {number}: {shown(line)}: must be {must}")


def _orbit_losses(path: Path) -> list[int]:
    """Whether each packet was lost, 0 or 1, in the order of sending."""
    numbers: list[int] = []
    for number, line in _lines(path):
        match = ORBIT_LINE.fullmatch(line)
        packet, strength = map(int, match.groups()) if match else (-1, -1)
        if not (0 <= packet <= ORBIT_NUMBER_MAX and strength <= ORBIT_STRENGTH_MAX):
            must = (
                f"a packet's number, 0 to {ORBIT_NUMBER_MAX}, and its signal strength, 0 to"
                f" {ORBIT_STRENGTH_MAX}, as in '17 31'"
            )
            raise _refused(path, number, line, must)
        if numbers and packet <= numbers[-1]:
            must = f"a packet after number {numbers[-1]}, the one of the line before"
            raise _refused(path, number, line, must)
        numbers.append(packet)
    losses = [1] * max(ORBIT_PACKETS, numbers[-1] + 1 if numbers else 0)
    for packet in numbers:
        losses[packet] = 0
    return losses


def _orbit_files(path: Path) -> dict[tuple[str, str], Path]:
    """The files of a noise level, by sender and receiver."""
    files: dict[tuple[str, str], Path] = {}
    for file in sorted(path.glob("*/*")):
        sender = ORBIT_SENDER.fullmatch(file.parent.name)
        receiver = ORBIT_RECEIVER.fullmatch(file.name)
        if sender is None or receiver is None:
            continue
        link = (sender[1], receiver[1])
        if link in files:
            raise TraceFileError(f"{file}: is of the same link as {files[link]}")
        files[link] = file
    if not files:
        raise TraceFileError(
            f"{path}: has no files of links, as in Results_node1-2_test/sdec1-4; give the folder of"
            " one noise level, or a link's file"
        )
    return files


def _check_nodes(path: Path, chosen: Sequence[str], known: Sequence[str]) -> None:
    for node in chosen:
        if node not in known:
            raise TraceFileError(f"{path}: has no node {shown(node)}; it has {', '.join(known)}")
        if chosen.count(node) > 1:
            raise TraceFileError(f"{path}: node {node} is named twice")
    if not 2 <= len(chosen) <= ROBOTS_MAX:
        raise TraceFileError(f"{path}: {len(chosen)} nodes, must be 2 to {ROBOTS_MAX}")


def _row_and_column(node: str) -> tuple[int, ...]:
    return tuple(map(int, node.split("-")))


def _half_s(path: Path, number: int, line: str) -> float:
    """Half of a round trip, in s."""
    try:
        half_s = float(line) / MS_PER_S / 2.0
    except ValueError:
        half_s = -1.0
    if not 0.0 <= half_s <= DELAY_S_MAX:  # also NaN
        most = f"{2.0 * DELAY_S_MAX * MS_PER_S:.0f}"
        raise _refused(path, number, line, f"the time of a round trip in ms, from 0 to {most}")
    return half_s
