"""The facts that a run's journal has, beside those that its inputs give."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from tca_central.errors import CentralError
from tca_central.shell.log_writer import numbers
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import Entry, Opened
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader


class WrittenFacts:
    """The entries of one run's journal after one of them, in their order."""

    def __init__(self, folder: Path, epoch: str, after: int, *, accept: bool) -> None:
        """*accept*: where the inputs give something else, the journal is cut."""
        self.opened: Opened | None = None  #: its newest segment's
        self.last = Entry(0, 0.0, [])  #: its last entry
        self._accept = accept
        self._folder, self._after = folder, after
        self._paths = self._of_run(epoch, after)
        self._place = (self._paths[0], 0) if self._paths else None  #: of ``_next``
        self._has_holes = False
        self._entries = self._read()
        self._next = next(self._entries, None)

    def missing(self, given: Iterable[Entry]) -> Iterator[Entry]:
        """Those of the entries that the inputs give that the journal lacks. Raises CentralError at a difference."""
        for entry in given:
            if self._next is None:
                self.last = entry
                yield entry
            elif self._next.number == entry.number:
                if not self._is_same(entry):
                    self._differ(f"entry {entry.number} is another one now")
                    self.last = entry
                    yield entry
            elif self._next.number < entry.number:
                self._differ(f"it has entry {self._next.number}, to which the inputs do not lead")
                self.last = entry
                yield entry
            elif not self._has_holes:
                self._differ(f"it lacks entry {entry.number}")
                self.last = entry
                yield entry

    def end(self) -> None:
        """The inputs give no more. Raises CentralError if the journal has more."""
        if self._next is not None:
            self._differ(f"it goes on with entry {self._next.number}, to which the inputs do not lead")
        elif self._paths:
            self._cut_tail()

    def _is_same(self, entry: Entry) -> bool:
        """Whether the next entry is this one. One that was too big for a record has several."""
        facts, number, time, cause = [], entry.number, entry.time, entry.cause
        is_same, place = True, self._place
        while self._next is not None and self._next.number == number:
            is_same = is_same and (self._next.time, self._next.cause) == (time, cause)
            facts += self._next.facts
            self.last, self._next = self._next, next(self._entries, None)
        if is_same and facts == entry.facts:
            return True
        self._place = place
        return False

    def _differ(self, what: str) -> None:
        assert self._place is not None
        path, offset = self._place
        if not self._accept:
            msg = f"{path}, byte {offset}: the journal differs from what the inputs lead to: {what}. A tca of another \
version may have written it, or a power cut taken the last inputs. --resume facts goes on with what the inputs lead to \
and puts aside what the journal has from there on; --fresh begins anew"
            raise CentralError(msg)
        for later in self._paths[self._paths.index(path) + 1 :]:
            later.rename(later.with_suffix(".aside"))
        with path.open("r+b") as stream:
            stream.seek(offset)
            path.with_suffix(".aside").write_bytes(stream.read())
            stream.truncate(offset)
        self._next = None

    def _cut_tail(self) -> None:
        """Take away what was being written: another segment follows."""
        path = self._paths[-1]
        if self._end < path.stat().st_size:
            with path.open("r+b") as stream:
                stream.truncate(self._end)

    # --- reading ---------------------------------------------------------------------------------------------------

    def _of_run(self, epoch: str, after: int) -> list[Path]:
        """The run's segments from the one in which that entry is."""
        found: list[Path] = []
        for number in reversed(numbers(self._folder, SEGMENT_SUFFIX)):
            path = self._folder / f"{number:08d}{SEGMENT_SUFFIX}"
            opened, first = _beginning(path)
            if opened is None:
                if found:
                    break
                path.unlink()  # central ended while it began it
                continue
            if opened.epoch != epoch:
                break
            self.opened = self.opened or opened
            found.append(path)
            if first <= after:
                break
        return found[::-1]

    def _read(self) -> Iterator[Entry]:
        self._end = 0
        for path in self._paths:
            with path.open("rb") as stream:
                reader = JournalReader(stream, str(path))
                try:
                    for entry in reader:
                        self._has_holes = self._has_holes or bool(reader.holes)
                        if entry.cause is None:
                            self.last = entry
                        elif entry.number > self._after:
                            self._place = (path, reader.offset)
                            yield entry
                        else:
                            self.last = entry
                except JournalDamaged:
                    self._has_holes = True
                self._end = reader.offset


def _beginning(path: Path) -> tuple[Opened | None, int]:
    """The first fact of a segment, and the number of the last entry before it."""
    with path.open("rb") as stream:
        try:
            entry = next(iter(JournalReader(stream, str(path))), None)
        except JournalDamaged:
            return None, 0
    if entry is None or not entry.facts or not isinstance(entry.facts[0], Opened):
        return None, 0
    return entry.facts[0], entry.number
