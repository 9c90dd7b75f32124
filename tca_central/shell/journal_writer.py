"""Writes the journal: a run's facts, in segments 00000001.tcaj, 00000002.tcaj, ... Knows nothing of
what they mean.

Where earlier runs lie in the folder, its segments have the next numbers; nothing is written to
theirs.
"""

import time
from pathlib import Path

from tca_central.shell.log_writer import LogWriter, Sync
from tca_wire.journal.facts import JOURNAL_VERSION, CentralFailed, Closed, Entry, Opened
from tca_wire.journal.records import SEGMENT_SUFFIX, record
from tca_wire.release import release


class JournalWriter(LogWriter):
    """One run's journal."""

    def __init__(
        self,
        folder: Path,
        *,
        epoch: str,
        sync: Sync,
        after: Opened | None = None,
        entry: Entry | None = None,
    ) -> None:
        """*after*: the newest segment of the same run, which goes on with what follows *entry*."""
        self._epoch = epoch
        self._last = entry or Entry(0, 0.0, [])  # entry
        self._began = time.time() - self._last.time
        self._segment = after.segment if after is not None else 0
        super().__init__(folder, SEGMENT_SUFFIX, sync)

    def head(self) -> bytes:
        """Each segment says which journal it belongs to."""
        self._segment += 1
        opened = Opened(JOURNAL_VERSION, self._epoch, self._segment, self._began, release())
        return record(Entry(self._last.number, self._last.time, [opened]))

    def add(self, entry: Entry) -> None:
        """Take an entry; ``flush`` writes it."""
        self._last = entry
        self.put(record(entry))

    def break_off(self, entry_number: int, time_now: float, why: str) -> None:
        """Write the rest. The run has not ended: it may go on."""
        if why and not self.is_broken:
            self.add(Entry(entry_number, time_now, [CentralFailed(why)]))
        self.close()

    def end(self, entry_number: int, time_now: float, why: str) -> None:
        """Write the rest and the end."""
        self.add(Entry(entry_number, time_now, [Closed(why)]))
        self.close()
