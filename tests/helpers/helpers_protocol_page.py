"""The page of the protocol, taken apart."""

import re

from helpers_paths import DOCS

PAGE = (DOCS / "protocol.md").read_text(encoding="utf-8")


def section(title):
    """The text under a heading, up to the next of its level."""
    return PAGE.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]


def program(title):
    return re.search(r"```python\n(.*?)```", section(title), re.DOTALL)[1]
