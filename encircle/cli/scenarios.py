"""``encircle scenarios``: which scenarios are shipped."""

import json
from collections.abc import Sequence

from encircle.protocol.process.log import say
from encircle.protocol.programs.options import Options


def main(arguments: Sequence[str], program: str) -> int:
    """List the shipped scenarios, a line each or as one JSON object; returns the exit status."""
    options = Options(program, "List the shipped scenarios.", environment=False)
    options.add_flag("--json", "print one JSON object, with every key of every scenario")
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for the scenario's model.
    from encircle.world.loading.files import shipped
    from encircle.world.loading.load import load

    scenarios = {name: load(name) for name in shipped()}
    if settings.json:
        say(json.dumps({name: s.model_dump(mode="json") for name, s in scenarios.items()}))
        return 0
    for name, scenario in scenarios.items():
        say(f"{name:12} {len(scenario.ids):3} robots  {scenario.title}")
    return 0
