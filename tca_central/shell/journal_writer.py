"""Writes the journal: a run's facts, in segments 00000001.tcaj, 00000002.tcaj, ...

The meaning of the facts does not matter here. In a folder with earlier runs, new segments have
higher numbers. The files of earlier runs stay as they are.
"""

import time
from pathlib import Path

from tca_central.shell.log_writer import LogWriter, Sync
from tca_wire.journal.facts import JOURNAL_VERSION, CentralFailed, Closed, Entry, Opened
from tca_wire.journal.records import SEGMENT_SUFFIX, record
from tca_wire.release import release


class JournalWriter(LogWriter):
    """One run's journal.

    Args:
        folder: The folder of the run.
        epoch: The epoch of the run.
        sync: When records must be on the disk.
        after: The head of the newest segment, in a run that continues.
        entry: The last entry, in a run that continues.
    """

    def __init__(
        self,
        folder: Path,
        *,
        epoch: str,
        sync: Sync,
        after: Opened | None = None,
        entry: Entry | None = None,
    ) -> None:
        self._epoch = epoch
        last = entry or Entry(0, 0.0, [])
        self._last = last.number, last.time  #: of the last entry
        self._began = time.time() - last.time
        self._segment = after.segment if after is not None else 0
        super().__init__(folder, SEGMENT_SUFFIX, sync)

    def head(self) -> bytes:
        """Return the first entry of the next segment, which names the journal."""
        self._segment += 1
        opened = Opened(JOURNAL_VERSION, self._epoch, self._segment, self._began, release())
        return record(Entry(*self._last, [opened]))

    def add(self, entry: Entry) -> None:
        """Append an entry; ``flush`` writes it."""
        self._last = entry.number, entry.time
        self.add_record(record(entry))

    def break_off(self, entry_number: int, time_now: float, why: str) -> None:
        """Write all entries and why central stops, and close the file. The run may continue."""
        if why and not self.is_broken:
            self.add(Entry(entry_number, time_now, [CentralFailed(why)]))
        self.close()

    def end(self, entry_number: int, time_now: float, why: str) -> None:
        """Write all entries, then that the run has ended, and close the file."""
        self.add(Entry(entry_number, time_now, [Closed(why)]))
        self.close()
