"""The generated tables of docs/learning.md: what an observation is made of, and the reward.

python -m encircle.learning.describe            is the page current? exit status 1 if not
python -m encircle.learning.describe --write    make it so
"""

import sys
from dataclasses import fields
from pathlib import Path

from encircle.learning.observing import OWN, PEER, RAY, SAID, TARGET, TOLD, Field
from encircle.learning.rewards import Reward
from encircle.protocol.programs.generated_pages import check_or_write, with_parts
from encircle.world.loading.declarations import field_docstrings

PAGE = Path("docs/learning.md")
_COMMAND = "python -m encircle.learning.describe"
_BEGIN = f"<!-- {{}}, from the code: {_COMMAND} -->\n"
_END = "<!-- end of what is from the code -->\n"
_NUMBERS = "| name | in | what it is |\n|---|---|---|\n"
_WEIGHTS = "| weight | default | meaning |\n|---|---|---|\n"


def sections() -> dict[str, str]:
    """What stands between the comments, by what the first of them names."""
    groups = {
        "own": OWN,
        "target": TARGET,
        "peer": PEER,
        "told": (*SAID, TOLD),
        "scan": (RAY,),
    }
    tables = {name: _NUMBERS + "".join(map(_row, group)) for name, group in groups.items()}
    meanings = field_docstrings(Reward)
    rows = [f"| `{f.name}` | {f.default} | {meanings[f.name]} |\n" for f in fields(Reward)]
    return {**tables, "reward": _WEIGHTS + "".join(rows)}


def current(page: str) -> str:
    """The page with its tables as the code has them; ``ValueError`` for one without."""
    return with_parts(page, {_BEGIN.format(name): text for name, text in sections().items()}, _END)


def _row(field: Field) -> str:
    scale = field.scale if field.scale in ("mask", "1") else f"`{field.scale}`"
    return f"| `{field.name}` | {scale} | {field.meaning} |\n"


def main(arguments: list[str]) -> int:
    """Check the page, or write it; the exit status."""
    return check_or_write(PAGE, current, _COMMAND, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
