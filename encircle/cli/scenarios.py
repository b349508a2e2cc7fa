"""``encircle scenarios``: which scenarios, and which profiles of channels, are shipped."""

import json
from collections.abc import Sequence

from encircle.cli.shipped import listed_profiles, listed_scenarios
from encircle.protocol.process.log import say
from encircle.protocol.programs.options import Options


def main(arguments: Sequence[str], program: str) -> int:
    """List the shipped scenarios, a line each or as one JSON object; returns the exit status."""
    options = Options(program, "List the shipped scenarios.", environment=False)
    options.add_flag("--json", "print one JSON object, with every key of every scenario")
    options.add_flag("--profiles", "list the profiles of channels (channel.profile) instead")
    settings = options.parse(arguments)
    if settings.profiles:
        profiles = listed_profiles()
        lines = [f"{name:18} {title}" for name, title in profiles.items()]
        say(*([json.dumps(profiles)] if settings.json else lines))
        return 0
    if not settings.json:
        for name, robots, title in listed_scenarios():
            say(f"{name:12} {robots:3} robots  {title}")
        return 0
    # Imported late: a list need not wait for the scenario's model.
    from encircle.world.loading.files import shipped
    from encircle.world.loading.load import load

    scenarios = {name: load(name).model_dump(mode="json") for name in shipped()}
    say(json.dumps(scenarios))
    return 0
