"""The inbox of a robot that hears its peers itself, over the real network.

A packet counts once it has arrived here and the modelled radio, if there is one, has admitted it:
the world says in each observation which packets (by sender and sequence) its radio lets through at
that tick. Either may come first, and a packet that the radio loses is never admitted. As with the
modelled radio, what was sent at tick t is heard at t + 1 at the earliest.

Neither order nor time of arrival means anything: what is taken out at a tick stands in order of
(tick, sender, sequence). All that is remembered is bounded, the oldest is forgotten first.
"""

from collections.abc import Iterable, Sequence

PENDING_MAX = 4096
"""Packets and admissions remembered per sender: ten seconds and more of the fastest sender."""


class DirectInbox:
    """What has arrived and what was admitted, by sender; ``peers`` in robot order."""

    def __init__(self, peers: Sequence[str]) -> None:
        self._arrived: dict[str, dict[int, tuple[int, bytes]]] = {peer: {} for peer in peers}
        self._admitted: dict[str, dict[int, None]] = {peer: {} for peer in peers}
        self._all_admitted = False

    def add_packet(self, sender: str, sequence: int, tick: int, packet: bytes) -> None:
        """A packet that ``sender`` made at ``tick`` has arrived."""
        arrived = self._arrived[sender]
        arrived[sequence] = (tick, packet)
        if len(arrived) > PENDING_MAX:
            del arrived[next(iter(arrived))]

    def admit(self, references: Iterable[tuple[str, int]] | None) -> None:
        """The radio lets these packets through; None: all that have arrived by now."""
        if references is None:
            self._all_admitted = True
            return
        for sender, sequence in references:
            if sender in self._admitted:
                admitted = self._admitted[sender]
                admitted[sequence] = None
                if len(admitted) > PENDING_MAX:
                    del admitted[next(iter(admitted))]

    def take(self, tick: int) -> tuple[bytes, ...]:
        """The packets heard at a tick, as their senders encoded them; each is taken once."""
        heard: list[tuple[int, int, int, bytes]] = []
        for index, (sender, arrived) in enumerate(self._arrived.items()):
            admitted = self._admitted[sender]
            through = arrived if self._all_admitted else arrived.keys() & admitted.keys()
            for sequence in list(through):
                sent_tick, packet = arrived[sequence]
                if sent_tick < tick:
                    heard.append((sent_tick, index, sequence, packet))
                    del arrived[sequence]
                    admitted.pop(sequence, None)
        # Until the next observation says so again.
        self._all_admitted = False
        return tuple([packet for *_, packet in sorted(heard)])
