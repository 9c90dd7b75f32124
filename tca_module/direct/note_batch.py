"""Notes for central on direct messages handled or lost, sent in batches."""

from collections import Counter

import msgspec

from tca_module.session.session import Session
from tca_wire.packets.routes import MOST_NOTES, Loss, Note, Noted

WITHIN = 0.1  # seconds after which notes are sent even if there is nothing else to send
FAR = float("inf")  # when nothing is due
NOTES_LOST = ""  # stands for a message's name where notes themselves were lost


class NoteBatch:
    """Notes to be sent. They are kept, up to a bound, while central is not there."""

    def __init__(self) -> None:
        self.due = FAR  #: when they are to be sent
        self._notes: list[tuple[float, Note]] = []  #: with the times when the messages ended
        self._losses: Counter[str] = Counter()

    def handled(self, note: Note, now: float) -> None:
        """Note that a direct message was handled."""
        if len(self._notes) >= MOST_NOTES:
            self.lost(NOTES_LOST, now)
            return
        self._notes.append((now - note.ago, note))
        self.due = min(self.due, now + WITHIN)

    def lost(self, message: str, now: float, number: int = 1) -> None:
        """Note that so many direct informs were lost."""
        self._losses[message] += number
        self.due = min(self.due, now + WITHIN)

    def report(self, session: Session, now: float, *, at_once: bool = False) -> None:
        """Send them if it is time, or if something else is sent anyway."""
        if not session.is_welcome or (not at_once and now < self.due and not session.outgoing):
            return
        notes = [
            msgspec.structs.replace(note, ago=max(0.0, now - ended)) for ended, note in self._notes
        ]
        session.post(
            Noted(notes, [Loss(message, number) for message, number in self._losses.items()])
        )
        self._notes.clear()
        self._losses.clear()
        self.due = FAR

    def restore(self, said: Noted, now: float) -> None:
        """Keep notes that could not be sent."""
        for note in said.notes:
            self.handled(note, now)
        for loss in said.losses:
            self.lost(loss.message, now, loss.number)
