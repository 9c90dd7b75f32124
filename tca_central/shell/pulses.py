"""Pulses: a process's socket that returns central's heartbeats, to show that the process runs.

A process without a pulse is not watched. Silence is counted in heartbeats, not in seconds. A
central that stood still has sent none, so it blames no process for its own pause.
"""

from collections.abc import Iterable

from tca_central.model.deliveries import Connection

LATE = 20
"""Extra heartbeats granted to a pulse that was never reached.

After a crash of the previous central's computer, a process notices within 10 s that its connection
is broken. Then it tries to reconnect, at least every 5 s.
"""
_REMEMBERED = 1000
"""The number of closed pulses that are remembered."""


class Pulses:
    """Counts the unanswered heartbeats of each pulse. Knows no socket and no clock."""

    def __init__(self, patience: int) -> None:
        """*patience* is the number of unanswered heartbeats after which a pulse is silent."""
        #: Routing ids that have sent packets since the last heartbeat.
        self.active: set[bytes] = set()
        self._patience = patience
        #: By pulse: heartbeats since the last sign of life. Below 0 while extra ones are granted.
        self._unanswered: dict[bytes, int] = {}
        self._reached: set[bytes] = set()  #: pulses that a heartbeat has reached

    def start_round(self, connections: Iterable[Connection]) -> set[bytes]:
        """Start the next round of heartbeats. Return the pulses that get a heartbeat."""
        connections = list(connections)
        pulses = {connection.pulse for connection in connections if connection.pulse}
        self._unanswered = {
            pulse: beats + 1 for pulse, beats in self._unanswered.items() if pulse in pulses
        }
        self.count_signs(connections)
        if len(self._reached) > len(pulses) + _REMEMBERED:
            self._reached &= pulses
        return pulses

    def count_signs(self, connections: Iterable[Connection]) -> None:
        """Reset the pulses of processes that have sent anything: each packet is a sign of life."""
        for connection in connections:
            pulse = connection.pulse
            if pulse in self._unanswered and (pulse in self.active or connection.id in self.active):
                self._unanswered[pulse] = 0 if pulse in self._reached else -LATE
        self.active.clear()

    def mark_sent(self, pulse: bytes) -> None:
        """Note that a heartbeat was sent to a pulse: an answer is due."""
        self._reached.add(pulse)
        self._unanswered[pulse] = max(self._unanswered.get(pulse, 0), 0)

    def mark_closed(self, pulse: bytes) -> None:
        """Note that a pulse's socket is closed.

        A pulse that was reached is no longer watched. One that was never reached gets LATE extra
        heartbeats, because its process may still reconnect.
        """
        if pulse in self._reached:
            self._unanswered.pop(pulse, None)
        else:
            self._unanswered.setdefault(pulse, -LATE)

    def silent(self) -> set[bytes]:
        """Return the pulses that have been silent for too long."""
        return {pulse for pulse, beats in self._unanswered.items() if beats >= self._patience}
