"""The parts of a journal that can't be read though those behind can, in words."""

from pathlib import Path

from tca_wire.journal.facts import JOURNAL_VERSION
from tca_wire.journal.records import JournalReader

_SINCE = "what seems to go on since then may have ended"


class Losses:
    """The losses, counted: damaged entries, facts that this version does not know, the ends of segments."""

    def __init__(self) -> None:
        self.entries = 0
        """Damaged ones; where not all can be told apart, there were more."""
        self.facts = 0
        """Those that this version does not know, or that are none."""
        self.ends: list[str] = []
        """Why no more could be read of a segment, where others follow."""
        self._is_counted = True
        self._first_entry = self._first_fact = ""
        """Where the first of them stands, and after what time."""
        self._later = ""
        """The first segment of a later version, and which."""

    def note(self, reader: JournalReader, segment: Path, holes: int, unknown: int, time: float) -> None:
        """A reader has passed over more than so many *holes* and *unknown* facts, behind what was written at *time*."""
        if new := reader.holes[holes:]:
            self.entries += len(new)
            self._is_counted = self._is_counted and reader.is_counted
            self._first_entry = self._first_entry or f"{segment}, byte {new[0]}, after {time:.3f} s"
        if reader.unknown > unknown:
            self.facts += reader.unknown - unknown
            self._first_fact = self._first_fact or f"{segment}, byte {reader.offset}, after {time:.3f} s"

    def note_version(self, reader: JournalReader, segment: Path) -> None:
        """A segment begins."""
        if reader.version > JOURNAL_VERSION and not self._later:
            which = f"{reader.version}; this one reads up to {JOURNAL_VERSION}"
            self._later = (
                f"{segment}: written by a later version ({which}), in which more may have happened: upgrade tca"
            )

    @property
    def places(self) -> int:
        """How often something was lost behind which nothing is sure."""
        return self.entries + len(self.ends)

    @property
    def lines(self) -> list[str]:
        """All of it in words."""
        found = [self._later, self._of_entries(), self._of_facts()]
        return [*filter(None, found), *(f"{end}; what comes behind it in that file is left out" for end in self.ends)]

    def _of_entries(self) -> str:
        if not self.entries:
            return ""
        most = "" if self._is_counted else "at least "
        what = "a damaged entry is" if self.entries == 1 else f"{most}{self.entries} damaged entries are"
        if not self._is_counted and self.entries == 1:
            what = "at least one entry, damaged or missing, is"
        return f"{self._first_entry}: {what} left out{', the first of them here' * (self.entries > 1)}: {_SINCE}"

    def _of_facts(self) -> str:
        if not self.facts:
            return ""
        what = "a fact that this version does not know is" if self.facts == 1 else f"{self.facts} facts are"
        first = ", the first of them here, that this version does not know" * (self.facts > 1)
        return f"{self._first_fact}: {what} left out{first}: {_SINCE}"
