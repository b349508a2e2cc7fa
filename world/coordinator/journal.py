"""The journal of a run: the digest of all that happens, what is to be recorded of it, and counts.

The digest covers the truth at every tick, every packet's fate, every pose and command in robot
order, and so which robots were lost, the setups of robots that are back, and interventions. It
covers neither the run's name nor how or in which order anything arrived.

Nobody waits for the journal. What happens is noted at once; ``commit`` counts, encodes, digests and
records it, and is called when there is time.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from encircle.protocol.codec import body_of, encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import Intervention
from encircle.world.arena import engine
from encircle.world.arena.engine import Arena, ArenaState
from encircle.world.channel.channel import Fates
from encircle.world.coordinator.answers import Answer
from encircle.world.coordinator.outgoing import Outgoing, radio_message
from encircle.world.coordinator.packet_counts import PacketCounts
from encircle.world.scenario.model import digest_header

Record = Callable[[int, str, bytes], None]
"""Records one message: tick, key, payload."""


class Entry(NamedTuple):
    """What is noted at a tick: parts for the digest, and messages for the recording."""

    tick: int
    digested: list[bytes]
    messages: Outgoing


class Journal:
    """The journal of one run.

    ``record`` gets every message of the run, if it is set. ``publishes``: whether ``commit``
    returns state and radio of every tick, for viewers; interventions it returns always.
    ``pending``: what makes the entries that are not committed yet, from whole states of the arena;
    ``hash``: over those that are.
    """

    def __init__(self, arena: Arena, run: str, record: Record | None = None) -> None:
        self.record = record
        self.publishes = False
        self.pending: list[Callable[[], Entry]] = []
        self.packets = PacketCounts()
        self.contacts = 0
        self._arena = arena
        self._run = run
        self._state_key = world_key(run, "state")
        self._intervention_key = world_key(run, "intervention")
        self._shown = (self._state_key, world_key(run, "radio"), self._intervention_key)
        header = digest_header(arena.scenario, arena.seed)
        self.hash = hashlib.blake2b(header.encode(), digest_size=16)

    @property
    def digest(self) -> str:
        """The digest of what was committed so far."""
        return self.hash.copy().hexdigest()

    def note_first_setups(self, setups: Outgoing) -> None:
        """Note the setups of all robots, in robot order, for the recording alone."""
        self.pending.append(partial(Entry, 0, [], setups))

    def note_state(self, state: ArenaState, setups: Outgoing, sent: Callable[[], Outgoing]) -> None:
        """Note the truth at a tick, the setups of robots that are back, and all messages sent.

        ``sent`` makes these, if they are recorded.
        """
        self.contacts += len(state.contacts)
        self.pending.append(partial(self._of_state, state, setups, sent))

    def _of_state(self, state: ArenaState, setups: Outgoing, sent: Callable[[], Outgoing]) -> Entry:
        messages: Outgoing = []
        if self.record is not None or self.publishes:
            shown = encode(engine.truth(self._arena, state), self._run)
            messages.append((self._state_key, shown))
        if self.record is not None:
            messages += sent()
        moving = len(self._arena.ids) + 1
        truth = state.positions[:moving].tobytes() + bytes([state.captured])
        returned = [body_of(payload, self._run) for _, payload in setups]
        return Entry(state.tick, [truth, *returned], messages)

    def note_intervention(self, tick: int, event: Mapping[str, Any]) -> None:
        """Note an event that was given at a tick, in whose round it stands before the answers."""
        payload = encode(Intervention(tick, event), self._run)
        message = (self._intervention_key, payload)
        self.pending.append(partial(Entry, tick, [body_of(payload, self._run)], [message]))

    def note_answers(self, tick: int, fates: Fates, answers: Sequence[Answer]) -> None:
        """Note the answers of a round, in robot order, and what becomes of their packets."""
        self.pending.append(partial(self._of_answers, tick, fates, answers))

    def _of_answers(self, tick: int, fates: Fates, answers: Sequence[Answer]) -> Entry:
        self.packets.add(tick, fates)
        digested, messages = [fates.due.tobytes()], []
        if fates.copies is not None:
            digested.append(fates.copies.tobytes())
        for robot, answer in zip(self._arena.ids, answers, strict=True):
            if not answer.command:
                continue
            if answer.packet is not None:
                digested.append(answer.digested_pose)
                messages.append((robot_key(self._run, robot, "pose"), answer.packet))
            digested.append(answer.digested_command)
            messages.append((robot_key(self._run, robot, "command"), answer.command))
        if self.record is not None or self.publishes:
            messages.append(radio_message(self._run, tick, fates))
        return Entry(tick, digested, messages)

    def commit(self) -> Outgoing:
        """Digest and record what was noted since the last call; returns what viewers are shown."""
        shown: Outgoing = []
        for noted in self.pending:
            tick, digested, messages = noted()
            for part in digested:
                self.hash.update(part)
            for key, payload in messages:
                if self.record is not None:
                    self.record(tick, key, payload)
                if key in self._shown:
                    shown.append((key, payload))
        self.pending.clear()
        return shown
