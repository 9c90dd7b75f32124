"""Compares the journals of several centrals of one run, and merges them."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync
from tca_tools.errors import ToolError
from tca_tools.journal.journals import open_log
from tca_tools.journal.segments import segments_in
from tca_wire.journal.facts import CentralFailed, Closed, Entry, Fact, Opened
from tca_wire.journal.records import JournalReader

_OWN = Opened, Closed, CentralFailed  # a central's own facts, which lead to no state


class Merged:
    """The entries of one run, from the folders of all centrals that have led or followed it."""

    def __init__(self, folders: list[Path]) -> None:
        self.wrong: list[str] = []
        self.entries: dict[int, list[Entry]] = {}
        self.writers = dict[int, Path]()  #: by number of an entry: the first one that has it
        self.epochs = set[str]()
        self.compared = 0
        self._segments: list[tuple[Path, set[int]]] = []
        for folder in folders:
            self._check_folder(folder)
            for path in [*segments_in(folder), *folder.glob("*.tcaj-aside")]:
                for found in self._pieces(path):
                    self._add(path, found)
        if len(self.epochs) > 1:
            self.wrong.append(f"there are several runs: {sorted(self.epochs)}")
        for segment, numbers in self._segments:
            span = range(min(numbers), max(numbers))
            missing = [one for one in span if one in self.entries and one not in numbers]
            if missing:
                self.wrong.append(f"{segment} has not the entries {missing[:10]} of the others")

    def _check_folder(self, folder: Path) -> None:
        """Check that users can read this folder's journal."""
        last = 0
        with redirect_stderr(StringIO()) as said:
            try:
                log = open_log(folder)
                for entry in log:
                    if entry.number < last:
                        self.wrong.append(f"{folder}: entry {entry.number} follows entry {last}")
                    last = entry.number
                log.check(of_missing=False)
            except ToolError as error:
                self.wrong.append(str(error))
        if "only the entries before it" in said.getvalue():
            self.wrong.append(f"{folder}: {said.getvalue()}")

    def _add(self, path: Path, found: dict[int, list[Entry]]) -> None:
        self._segments.append((path, set(found)))
        last = max(found)
        for number, entries in found.items():
            known = self.entries.setdefault(number, entries)
            writer = self.writers.setdefault(number, path)
            if known is entries:
                continue
            self.compared += 1
            shorter = min(len(known), len(entries)) if number == last else None
            if known[:shorter] != entries[:shorter]:
                self.wrong.append(f"entry {number} is {known} in {writer}, but {entries} in {path}")
            if len(entries) > len(known):
                self.entries[number] = entries

    def _pieces(self, path: Path) -> Iterator[dict[int, list[Entry]]]:
        """Yield the entries of each segment in a file, by number."""
        found = defaultdict[int, list[Entry]](list)
        with path.open("rb") as stream:
            reader = JournalReader(stream, str(path))
            for entry in reader:
                opened = [fact.epoch for fact in entry.facts if isinstance(fact, Opened)]
                self.epochs.update(opened)
                if opened and found:
                    yield found
                    found = defaultdict(list)
                facts: list[Fact] = [fact for fact in entry.facts if not isinstance(fact, _OWN)]
                if facts or not entry.facts:
                    found[entry.number].append(Entry(entry.number, entry.time, facts, entry.cause))
            if reader.holes:
                self.wrong.append(f"{path} is damaged")
        if found:
            yield found

    def write(self, folder: Path) -> None:
        """Write one journal of all entries."""
        folder.mkdir()
        writer = JournalWriter(folder, epoch=next(iter(self.epochs), ""), sync=Sync.NONE)
        last = Entry(0, 0.0, [])
        for number in sorted(self.entries):
            for last in self.entries[number]:
                writer.add(last)
            if not number % 1000:
                writer.flush()
        writer.end(last.number + 1, last.time, "merged")
