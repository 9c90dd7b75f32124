"""The state of a run that ended without a goodbye: newest image, and the inputs since, through ``Central.handle``.

What comes out is compared with the facts that the journal has. The journal may lack the last ones: they are written
anew. Any other difference is told and stops the recovery, unless it is to be accepted: then what the journal has from
there on is put aside.
"""

import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import ConnectionLost, Restarted
from tca_central.shell.input_log import Head, InputSegment, this_boot
from tca_central.shell.log_writer import Sync
from tca_central.shell.replaying import InputReplay, NoReplay, check_heads, has_ended, newest_run
from tca_central.shell.written_facts import WrittenFacts
from tca_wire.journal.facts import Entry, Opened

GRACE = 10.0
"""Seconds that modules have to come back."""

SKIPPED = 1_000_000
"""Numbers that are passed over where the last second of the inputs may be lost: some may have been given in it."""


@dataclass
class UnfinishedRun:
    """A run that can go on."""

    central: Central
    head: Head  #: of its newest segment of inputs
    first: int  #: the number of its first one
    opened: Opened | None  #: of the newest segment of its journal
    last: Entry  #: the last entry of its journal
    missing: list[Entry] = field(default_factory=list)  #: entries that the journal lacks
    inputs: int = 0  #: number of those handled again
    is_cut: bool = False  #: some of its inputs may have been left out
    known: int = 0  #: number of the events before them

    def restarted(self, *, hold: bool) -> Restarted:
        """The event with which it goes on."""
        clock = self.central.clock.now
        away = max(0.0, time.time() - self.head.wall - (clock - self.head.clock))
        is_safe = self.head.sync is Sync.ALWAYS or (self.head.sync is Sync.BATCH and not self.was_booted)
        is_sure = is_safe and not self.is_cut
        return Restarted(clock, away, GRACE, hold, 0 if is_sure else SKIPPED)

    @property
    def was_booted(self) -> bool:
        """Whether the machine has started anew since."""
        return self.head.boot != this_boot()

    def gone(self) -> Iterator[ConnectionLost]:
        """Those connections whose processes, on this machine, are no more."""
        here, now = f"{socket.gethostname()}:", self.central.clock.now
        for connection in list(self.central.hold.awaited):
            process = connection.module.process
            pid = process.removeprefix(here)
            is_here = process.startswith(here) and pid.isdecimal()
            if is_here and (self.was_booted or not _lives(pid)) and Path("/proc/self").exists():
                yield ConnectionLost(now, connection.id, "its process had ended when central came back")


def _lives(process: str) -> bool:
    """Whether a process has not ended; one whose exit code nobody has asked for has."""
    try:
        state = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(") ")[2][:1]
    except OSError:
        return False
    return state not in ("Z", "X")


def unfinished(folder: Path, *, accept: bool = False) -> list[InputSegment]:
    """The segments of inputs of the newest run in a folder, oldest first; none if it has ended of its own will. Those
    of which not even the head can be read are passed over only with *accept*. Raises CentralError.
    """
    if not accept:
        check_heads(folder)
    found = newest_run(folder)
    return [] if found and has_ended(found) else found


def recover(folder: Path, segments: list[InputSegment], *, accept: bool = False) -> UnfinishedRun:
    """The run whose inputs these are. With *accept* it goes on in spite of a difference. Raises CentralError."""
    try:
        replay = InputReplay(folder, segments, cuts=accept)
        facts = WrittenFacts(folder, replay.central.epoch, replay.central.events)
        missing: list[Entry] = []
        given = replay.entries()
        while (difference := facts.compare(given, missing)) is not None:
            if not accept:
                raise difference
            facts.put_aside(difference)
    except NoReplay as error:
        msg = f"{error}; --fresh begins a new run there"
        raise CentralError(msg) from None
    facts.cut_tail()
    head = segments[-1].head
    assert head is not None
    known = replay.began
    return UnfinishedRun(
        replay.central, head, segments[0].number, facts.opened, facts.last, missing, replay.inputs, accept, known
    )
