"""What this world says of its run to whoever looks on and asks: scenario, seed, setups."""

from collections.abc import Callable
from contextlib import suppress

from encircle.protocol.keys import world_key
from encircle.protocol.plugins import PluginLoadError, UnknownPlugin
from encircle.protocol.zenoh.scenario_query import CHANNEL, RunDescription, description_replier
from encircle.world.coordinator.round_engine import RoundEngine


def description_answer(rounds: RoundEngine) -> tuple[str, Callable[[], bytes]]:
    """The key on which it is asked for, and what makes the answer, in any thread."""

    def describe() -> RunDescription:
        arena = rounds.arena
        setups: tuple[bytes, ...] = ()
        with suppress(PluginLoadError, UnknownPlugin):  # the policy's file is there no more
            setups = rounds.first_setups()
        # As in the recording, whole, with the defaults of this version; and as played so far.
        scenario = arena.scenario.model_dump_json()
        return RunDescription(rounds.run, arena.seed, scenario, setups)

    reply = description_replier(describe, lambda: len(rounds.interventions))
    return world_key(rounds.run, CHANNEL), reply
