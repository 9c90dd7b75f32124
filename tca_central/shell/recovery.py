"""The state of a run that ended without a goodbye: newest image, and the inputs since, through
``Central.handle``.

What comes out is compared with the facts that the journal has. The journal may lack the last ones:
they are written anew. It may have more where the last inputs did not reach the disk: those facts
are put aside, and reported. Any other difference is told and stops the recovery, unless it is to be
accepted. Then the ends of all logs are mended, before anything is written (decision 102).
"""

import logging
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import ConnectionLost, Restarted
from tca_central.shell.input_log import INPUT_SUFFIX, Head, InputSegment, this_boot
from tca_central.shell.log_writer import Sync
from tca_central.shell.replaying import InputReplay, NoReplay, check_heads, has_ended, newest_run
from tca_central.shell.written_facts import WrittenFacts, is_closed, newest_segment
from tca_wire.journal.facts import Entry, Opened

log = logging.getLogger("tca.central")

GRACE = 10.0
"""Seconds that modules have to come back."""

LONGEST_AWAY = 30 * 86_400.0
"""Seconds that a run's clock goes on at most where the machine was started anew: it may have had no
clock before.
"""

SKIPPED = 1_000_000
"""Numbers that are passed over where the last second of the inputs may be lost: some may have been
given in it.
"""


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
    may_lack: bool = False  #: some of its last inputs are not there
    known: int = 0  #: number of the events before them
    kept: int = 0  #: the number of the first segment with them, at which the image is
    aside: int = 0  #: entries that its journal had beyond the inputs

    def restarted(self, *, hold: bool) -> Restarted:
        """The event with which it goes on."""
        clock = self.central.clock.now
        # the wall clock may have been set since
        longest = LONGEST_AWAY if _was_booted(self.head) else time.monotonic()
        away = min(max(0.0, time.time() - self.head.wall - (clock - self.head.clock)), longest)
        return Restarted(clock, away, GRACE, hold, SKIPPED if self.may_lack else 0, self.aside)

    def gone(self) -> Iterator[ConnectionLost]:
        """Those connections whose processes, on this machine, are no more."""
        here, now = f"{socket.gethostname()}:", self.central.clock.now
        for connection in list(self.central.hold.awaited):
            process = connection.module.process
            pid = process.removeprefix(here)
            is_here = process.startswith(here) and pid.isdecimal()
            if (
                is_here
                and (_was_booted(self.head) or not _lives(pid))
                and Path("/proc/self").exists()
            ):
                yield ConnectionLost(
                    now, connection.id, "its process had ended when central came back"
                )


def _was_booted(head: Head) -> bool:
    """Whether the machine has started anew since."""
    return head.boot != this_boot()


def _lives(process: str) -> bool:
    """Whether a process has not ended; one whose exit code nobody has asked for has."""
    try:
        state = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(") ")[2][:1]
    except OSError:
        return False
    return state not in ("Z", "X")


def unfinished(folder: Path, *, accept: bool = False) -> list[InputSegment]:
    """The segments of inputs of the newest run in a folder, oldest first; none if it has ended of
    its own will. Those of which not even the head can be read are passed over only with *accept*.
    Raises CentralError.
    """
    if not accept:
        check_heads(folder)
    found = newest_run(folder)
    newest = None if accept else newest_segment(folder)
    if newest is not None and not newest_run(folder, newest[1]) and not is_closed(newest[0]):
        log.warning(
            "a new run begins, and the tasks of the last one in %s are lost: it has not ended, and has no \
inputs (*%s) with which it could continue",
            folder,
            INPUT_SUFFIX,
        )
    return [] if found and has_ended(found) else found


def recover(folder: Path, segments: list[InputSegment], *, accept: bool = False) -> UnfinishedRun:
    """The run whose inputs these are. With *accept* it goes on in spite of a difference. Raises
    CentralError.
    """
    head = segments[-1].head
    assert head is not None
    may_lack = head.sync is Sync.NONE or (head.sync is Sync.BATCH and _was_booted(head))
    try:
        replay = InputReplay(folder, segments, cuts=accept, may_lack=may_lack)
        facts = WrittenFacts(folder, replay.central.epoch, replay.central.events)
        missing: list[Entry] = []
        given = replay.entries()
        while (difference := facts.compare(given, missing)) is not None:
            if not accept and not (may_lack and difference.given is None):
                raise difference
            facts.put_aside(difference)
    except NoReplay as error:
        msg = f"{error}; --fresh begins a new run there"
        raise CentralError(msg) from None
    replay.mend()
    facts.mend()
    if may_lack:
        what = (
            "the last inputs"
            if head.sync is Sync.NONE
            else "up to the last second before power was lost"
        )
        log.warning(
            "%s may be missing (--sync %s); %d entries of the journal, to which no input leads, were put aside",
            what,
            head.sync,
            facts.aside,
        )
    return UnfinishedRun(
        replay.central,
        head,
        segments[0].number,
        facts.opened,
        facts.last,
        missing,
        replay.inputs,
        accept or may_lack,
        replay.began,
        replay.first,
        facts.aside,
    )
