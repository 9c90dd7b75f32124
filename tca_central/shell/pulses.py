"""Pulses: connections on which processes send back central's beats, and so show that they still
run.

A client that names none is not watched. Silence is counted in beats, not in seconds: a central that
stood still has sent none meanwhile, so it blames nobody for its own lateness.
"""

from collections.abc import Iterable

from tca_central.model.deliveries import Connection

LATE = 20
"""So many beats are let pass for a line that has never been there. A process notices within 10 s
that its line leads nowhere any more, as when the computer of the central before went down, and
connects it anew at least every 5 s.
"""
_REMEMBERED = 1000
"""The number of lines remembered of those that have left."""


class Pulses:
    """Counts the unanswered beats of each pulse. Knows no socket and no clock."""

    def __init__(self, patience: int) -> None:
        """*patience*: so many beats without a word are too many."""
        self.heard: set[bytes] = set()  #: routing ids of all that has come since the last beat
        self._patience = patience
        self._unanswered: dict[bytes, int] = {}
        self._met: set[bytes] = set()  #: those whose line has been there

    def beat(self, connections: Iterable[Connection]) -> set[bytes]:
        """It is time for the next beat: the pulses that it goes to."""
        connections = list(connections)
        pulses = {connection.pulse for connection in connections if connection.pulse}
        self._unanswered = {
            pulse: beats + 1 for pulse, beats in self._unanswered.items() if pulse in pulses
        }
        self.listen(connections)
        if len(self._met) > len(pulses) + _REMEMBERED:
            self._met &= pulses
        return pulses

    def listen(self, connections: Iterable[Connection]) -> None:
        """Note the pulses that were heard: any word from a process is a sign of life."""
        for connection in connections:
            pulse = connection.pulse
            if pulse in self._unanswered and (pulse in self.heard or connection.id in self.heard):
                self._unanswered[pulse] = 0 if pulse in self._met else -LATE
        self.heard.clear()

    def sent(self, pulse: bytes) -> None:
        """A beat is on its way to it: an answer is due."""
        self._met.add(pulse)
        self._unanswered[pulse] = max(self._unanswered.get(pulse, 0), 0)

    def gone(self, pulse: bytes) -> None:
        """Note that a pulse's line is gone. The process is suspect only if the line was never
        there.
        """
        if pulse in self._met:
            self._unanswered.pop(pulse, None)
        else:
            self._unanswered.setdefault(pulse, -LATE)

    def silent(self) -> set[bytes]:
        """Pulses that have been silent for too long."""
        return {pulse for pulse, beats in self._unanswered.items() if beats >= self._patience}
