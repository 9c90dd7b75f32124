"""Notes for central on direct messages, sent in batches: what was handled, what was lost."""

from collections import Counter

from tca_module.session.session import Session
from tca_wire.packets.routes import MOST_NOTES, Loss, Note, Noted
from tca_wire.vocabulary import Outcome

WITHIN = 0.1
"""Seconds after which notes are sent even if there is nothing else to send."""

FAR = float("inf")
"""When nothing is due."""

NOTES_LOST = ""
"""Stands for a message's name where notes themselves were lost."""


class NoteBatch:
    """Notes to be sent. They are kept, up to a bound, while central is not there."""

    def __init__(self) -> None:
        self.due = FAR  #: when they are to be sent
        self._notes: list[tuple[float, str, str, int, int, float, Outcome, str]] = []
        self._losses: Counter[str] = Counter()

    def handled(
        self, ended: float, message: str, sender: str, origin: int, size: int, seconds: float, outcome: Outcome,
        failure: str,
    ) -> None:  # fmt: skip
        """Note that a direct message was handled."""
        if len(self._notes) >= MOST_NOTES:
            self.lost(NOTES_LOST, ended)
            return
        self._notes.append((ended, message, sender, origin, size, seconds, outcome, failure))
        self.due = min(self.due, ended + WITHIN)

    def lost(self, message: str, now: float) -> None:
        """Note that a direct inform was lost."""
        self._losses[message] += 1
        self.due = min(self.due, now + WITHIN)

    def report(self, session: Session, now: float, *, at_once: bool = False) -> None:
        """Send them if it is time, or if something else is sent anyway."""
        if not session.is_welcome or (not at_once and now < self.due and not session.outgoing):
            return
        notes = [
            Note(message, sender, origin, size, max(0.0, now - ended), seconds, outcome, failure)
            for ended, message, sender, origin, size, seconds, outcome, failure in self._notes
        ]
        session.post(Noted(notes, [Loss(message, number) for message, number in self._losses.items()]))
        self._notes.clear()
        self._losses.clear()
        self.due = FAR

    def restore(self, said: Noted, now: float) -> None:
        """Keep notes that could not be sent."""
        for note in said.notes:
            self.handled(now - note.ago, *_what(note))
        for loss in said.losses:
            self._losses[loss.message] += loss.number
            self.due = min(self.due, now + WITHIN)


def _what(note: Note) -> tuple[str, str, int, int, float, Outcome, str]:
    return note.message, note.sender, note.origin, note.size, note.seconds, note.outcome, note.failure
