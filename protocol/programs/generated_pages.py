"""Pages of which a part is written from declarations in the code: whether they are current.

A generated part stands between two comments, of which the first names it. Whatever else is on the
page is written by hand.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from encircle.protocol.process.log import say, say_error


def with_parts(page: str, parts: Mapping[str, str], end: str) -> str:
    """The page with each part put after the comment that is its key, up to the comment ``end``.

    ``ValueError`` for a comment that is not there, or not there once.
    """
    for begin, text in parts.items():
        before, *rest = page.split(begin)
        if len(rest) != 1 or end not in rest[0]:
            raise ValueError(f"{len(rest)} places for {begin.strip()}, 1 is needed")
        page = before + begin + text + rest[0][rest[0].index(end) :]
    return page


def check_or_write(
    page: Path, current: Callable[[str], str], command: str, arguments: Sequence[str]
) -> int:
    """Check a page, or write it if ``arguments`` are ``--write``; the exit status.

    ``current`` makes a page's text current, or raises ``ValueError``.
    """
    if list(arguments) not in ([], ["--write"]):
        say_error(f"usage: {command} [--write]")
        return 2
    try:
        text = page.read_text(encoding="utf-8")
        described = current(text)
    except (OSError, ValueError) as error:
        say_error(f"{page}: {error}")
        return 1
    if described == text:
        say(f"{page} is current")
        return 0
    if not arguments:
        say_error(f"{page} is not current: run {command} --write")
        return 1
    page.write_text(described, encoding="utf-8")
    say(f"{page} is written")
    return 0
