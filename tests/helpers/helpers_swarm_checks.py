"""What a run of the swarm is held to beside its witness: it is one run, however it is come by.

Of eight seeds in a row, the first four have one of these checks each:

- what strangers send changes nothing: no message but what it counts of them, and no digest;
- played once more it is the same, message by message;
- a world that is fed with its recording comes to its digest; cut anywhere, to what was recorded
  before the cut; and fresh brains decide what was decided;
- without faults, answers in another order change nothing, and a run that is gone on with from any
  cut ends as the unbroken one.
"""

import random
from collections.abc import Callable, Sequence
from pathlib import Path

from helpers_swarm import RUN, Played, play, recorded

from encircle.replay.replaying import replay
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.loading.interventions import as_played
from encircle.world.recording.recording import INTERVENTION, Recording
from encircle.world.recording.resuming import digest_of, rebuild
from encircle.world.recording.run_directory import versions

CHECKED_EVERY = 8
Messages = Sequence[tuple[int, str, bytes]]


def checked(seed: int) -> Played:
    """A run of a seed that is what it must be; ``AssertionError`` if it is not."""
    played = recorded(seed, junk=True)
    for check in CHECKS[seed % CHECKED_EVERY :][:1]:
        check(seed, played)
        played.faults[f"check: {check.__name__}"] += 1
    return played


def untouched_by_strangers(seed: int, played: Played) -> None:
    """Without what strangers send; a robot's commands count it, which no digest covers."""
    without = recorded(seed, junk=False)
    assert _without_commands(without) == _without_commands(played), "junk has an effect"
    assert without.result.digest == played.result.digest, "junk has an effect on the digest"


def the_same_once_more(seed: int, played: Played) -> None:
    """Once more, by a world that works ahead."""
    again = recorded(seed, junk=True, ahead=True)
    assert again.messages == played.messages, "played again, working ahead, it is another run"
    assert again.result == played.result


def played_back(seed: int, played: Played) -> None:
    """By a world that is fed with the recording, and by fresh brains."""
    whole = recording_of(played, played.messages, complete=True)
    assert digest_of(whole) == played.result.digest, "played back it has another digest"
    check = replay(whole)
    by_its_brain = [d for d in check.differences if d[1] not in played.reckless]
    assert not by_its_brain, f"fresh brains decide otherwise: {by_its_brain[:3]}"
    cut = random.Random(f"swarm cut {seed}").randint(0, len(played.messages))
    resumed = rebuild(recording_of(played, played.messages[:cut]))
    common = min(cut, len(resumed.messages))
    assert _topics(resumed.messages)[:common] == played.messages[:common], f"cut at {cut}"


def the_same_in_any_order(seed: int, _: Played) -> None:
    """Without faults: answers in another order, and gone on with from a cut."""
    quiet = recorded(seed, faults=False)
    other = play(seed, faults=False, order=2)
    assert other.digest == quiet.result.digest, "the order of answers has an effect"
    cut = random.Random(f"swarm cut {seed}").randint(0, len(quiet.messages) - 1)
    resumed = rebuild(recording_of(quiet, quiet.messages[:cut]))
    more = list(resumed.messages)
    result = run_in_memory(
        build(quiet.scenario, quiet.scenario.seed),
        RUN,
        lambda _line: None,
        lambda *message: more.append(message),
        resumed=resumed,
    )
    assert _topics(more) == quiet.messages, f"cut at {cut} it goes on otherwise"
    assert result.digest == quiet.result.digest


CHECKS: tuple[Callable[[int, Played], None], ...] = (
    untouched_by_strangers,
    the_same_once_more,
    played_back,
    the_same_in_any_order,
)


def recording_of(played: Played, messages: Messages, complete: bool = False) -> Recording:
    """A recording that holds these messages, as if it had been read."""
    as_it_went = played.scenario
    for _, topic, payload in messages:
        if topic == INTERVENTION:
            as_it_went = as_played(as_it_went, payload, RUN)
    return Recording(
        Path("recording.mcap"),
        as_it_went,
        played.scenario.seed,
        RUN,
        tuple(messages),
        complete,
        versions(),
        written=played.scenario,
    )


def _topics(messages: Messages) -> list[tuple[int, str, bytes]]:
    return [(tick, key.removeprefix(f"encircle/{RUN}/"), body) for tick, key, body in messages]


def _without_commands(played: Played) -> list[tuple[int, str, bytes]]:
    return [message for message in played.messages if not message[1].endswith("/command")]
