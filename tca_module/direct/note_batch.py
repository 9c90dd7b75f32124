"""Notes for central about direct messages that were handled or lost, sent in batches."""

from collections import Counter

import msgspec

from tca_module.session.session import Session
from tca_wire.packets.routes import MOST_NOTES, Loss, Note, Noted

_SENT_WITHIN = 0.1  # seconds after which notes are sent even without other packets
NEVER = float("inf")  # the due time while there are no notes
NOTES_LOST = ""  # used like a message's name, to count lost notes


class NoteBatch:
    """Notes to be sent. While central is away, a limited number of notes is retained."""

    def __init__(self) -> None:
        self.due = NEVER  #: when to send the notes
        #: time at which the message was handled, and its note
        self._notes: list[tuple[float, Note]] = []
        self._losses: Counter[str] = Counter()

    def add_handled(self, note: Note, now: float) -> None:
        """Add a note that a direct message was handled."""
        if len(self._notes) >= MOST_NOTES:
            self.add_lost(NOTES_LOST, now)
            return
        self._notes.append((now - note.ago, note))
        self.due = min(self.due, now + _SENT_WITHIN)

    def add_lost(self, message: str, now: float, number: int = 1) -> None:
        """Add a note that *number* direct informs were lost."""
        self._losses[message] += number
        self.due = min(self.due, now + _SENT_WITHIN)

    def report(self, session: Session, now: float, *, at_once: bool = False) -> None:
        """Send the notes if they are due, or if other headers are sent anyway."""
        if not session.is_welcome or (not at_once and now < self.due and not session.outgoing):
            return
        replace = msgspec.structs.replace
        notes = [replace(note, ago=max(0.0, now - ended)) for ended, note in self._notes]
        session.post(Noted(notes, [Loss(*loss) for loss in self._losses.items()]))
        self._notes.clear()
        self._losses.clear()
        self.due = NEVER

    def restore(self, sent: Noted, now: float) -> None:
        """Retain notes that could not be sent."""
        for note in sent.notes:
            self.add_handled(note, now)
        for loss in sent.losses:
            self.add_lost(loss.message, now, loss.number)
