"""The inbox of a robot that receives its peers' packets directly, over the real network.

A packet counts once it has arrived here and the channel model, if there is one, has admitted it:
the world says in each observation which packets (by sender and sequence) its channel lets through
at that tick. Arrival and admission may come in either order, and a packet that the channel loses is
never admitted. As with packets that go through the world, what was sent at tick t counts at t + 1
at the earliest.

Neither order nor time of arrival means anything: the packets of a tick are ordered by (tick,
sender, sequence). All that is remembered is bounded; the oldest is forgotten first.
"""

from collections.abc import Iterable, Sequence

PENDING_MAX = 4096
"""Packets and admissions remembered per sender: ten seconds and more of the fastest sender."""


class DirectInbox:
    """The packets that have arrived, and those admitted, by sender; ``peers`` in robot order."""

    def __init__(self, peers: Sequence[str]) -> None:
        self._arrived: dict[str, dict[int, tuple[int, bytes]]] = {peer: {} for peer in peers}
        self._admitted: dict[str, dict[int, None]] = {peer: {} for peer in peers}
        self._all_before = 0
        self._all_admitted = False

    def add_packet(self, sender: str, sequence: int, tick: int, packet: bytes) -> None:
        """A packet that ``sender`` made at ``tick`` has arrived."""
        arrived = self._arrived[sender]
        arrived[sequence] = (tick, packet)
        if len(arrived) > PENDING_MAX:
            del arrived[next(iter(arrived))]
        if tick < self._all_before:
            self._admit_one(sender, sequence)

    def admit(self, references: Iterable[tuple[str, int]] | None, tick: int) -> None:
        """At a tick the channel admits these packets; None: all that were sent before it.

        None may turn into these in a run, by an event that is given to it.
        """
        if references is None:
            self._all_before, self._all_admitted = tick, True
            return
        for sender, sequence in references:
            if sender in self._admitted:
                self._admit_one(sender, sequence)

    def _admit_one(self, sender: str, sequence: int) -> None:
        admitted = self._admitted[sender]
        admitted[sequence] = None
        if len(admitted) > PENDING_MAX:
            del admitted[next(iter(admitted))]

    def take(self, tick: int) -> tuple[bytes, ...]:
        """The packets that count at a tick, as their senders encoded them; each is taken once."""
        taken: list[tuple[int, int, int, bytes]] = []
        for index, (sender, arrived) in enumerate(self._arrived.items()):
            admitted = self._admitted[sender]
            deliverable = arrived if self._all_admitted else arrived.keys() & admitted.keys()
            for sequence in list(deliverable):
                sent_tick, packet = arrived[sequence]
                if sent_tick < tick and (sent_tick < self._all_before or sequence in admitted):
                    taken.append((sent_tick, index, sequence, packet))
                    del arrived[sequence]
                    admitted.pop(sequence, None)
        # This holds for one observation only.
        self._all_admitted = False
        return tuple([packet for *_, packet in sorted(taken)])
