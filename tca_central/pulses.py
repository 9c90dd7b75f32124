"""Which processes still go on: each has a pulse, a connection on which it sends back central's beats.

A client that names none is not watched. Silence is counted in beats, not in seconds: a central that stood still has
sent none meanwhile, so it blames nobody for its own lateness.
"""

from collections.abc import Iterable

from tca_central.registry import Connection


class Pulses:
    """How many beats each pulse has left unanswered. Knows no socket and no clock."""

    def __init__(self, patience: int) -> None:
        """*patience*: so many beats without a word are too many."""
        self.heard: set[bytes] = set()  #: routing ids of all that has come since the last beat
        self._patience = patience
        self._unanswered: dict[bytes, int] = {}

    def beat(self, connections: Iterable[Connection]) -> set[bytes]:
        """It is time for the next beat: the pulses that it goes to."""
        connections = list(connections)
        pulses = {connection.pulse for connection in connections if connection.pulse}
        self._unanswered = {pulse: beats + 1 for pulse, beats in self._unanswered.items() if pulse in pulses}
        self.listen(connections)
        return pulses

    def listen(self, connections: Iterable[Connection]) -> None:
        """Note who has been heard: any word from a process is a sign of life."""
        for connection in connections:
            pulse = connection.pulse
            if pulse in self._unanswered and (pulse in self.heard or connection.id in self.heard):
                self._unanswered[pulse] = 0
        self.heard.clear()

    def sent(self, pulse: bytes) -> None:
        """A beat is on its way to it: an answer is due."""
        self._unanswered.setdefault(pulse, 0)

    def gone(self, pulse: bytes) -> None:
        """Its line is not there: no reason to blame the process, whose other connections tell when they close."""
        self._unanswered.pop(pulse, None)

    def silent(self) -> set[bytes]:
        """Pulses that have been silent for too long."""
        return {pulse for pulse, beats in self._unanswered.items() if beats >= self._patience}
