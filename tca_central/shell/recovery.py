"""Recovers an unfinished run by a replay of the inputs since its newest image.

A run is unfinished if it did not end regularly. The recovery compares the facts of the replay with
those in the journal. If the journal lacks the last facts, they are written again. If the last
inputs did not reach the disk, the journal may have facts to which no input leads. These facts are
moved to files beside the journal, and reported. Any other difference stops the recovery with an
error, unless the user accepts the difference (--resume facts). Before anything is written, all logs
are cut after their last sound record (decision 102).
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
from tca_central.inputs import Adopt
from tca_central.shell.input_log import INPUT_SUFFIX, Head, InputSegment, this_boot
from tca_central.shell.log_writer import Sync
from tca_central.shell.replaying import InputReplay, NoReplay, check_heads, has_ended, newest_run
from tca_central.shell.written_facts import WrittenFacts, is_closed, newest_segment
from tca_wire.journal.facts import Entry, Opened

log = logging.getLogger("tca.central")

GRACE = 10.0
"""Seconds that modules have to reconnect."""

LONGEST_AWAY = 30 * 86_400.0
"""The longest absence (s) to assume after a reboot: the clock may have been wrong before it."""

SKIPPED = 1_000_000
"""Ids to skip when the last inputs may be lost: the lost inputs may have used some of these."""


@dataclass
class UnfinishedRun:
    """A run that can continue."""

    central: Central
    head: Head  #: the head of its newest segment of inputs
    first_segment: int  #: the number of its first segment of inputs
    opened: Opened | None  #: the head of the newest segment of its journal
    last: Entry  #: the last entry of its journal
    missing: list[Entry] = field(default_factory=list)  #: entries that the journal lacks
    inputs: int = 0  #: the number of replayed inputs
    may_lack: bool = False  #: whether its last inputs may be missing
    image_events: int = 0  #: the number of events that led to the image
    image: int = 0  #: the number of the image, and of the first segment after it
    aside: int = 0  #: the number of entries that its journal had beyond the inputs

    def restarted(self, *, hold: bool) -> Restarted:
        """Return the event with which it continues."""
        clock = self.central.clock.now
        # The wall clock may have been set in the meantime. Without a reboot, no absence is longer
        # than the uptime.
        longest = LONGEST_AWAY if _was_booted(self.head) else time.monotonic()
        away = min(max(0.0, time.time() - self.head.wall - (clock - self.head.clock)), longest)
        return Restarted(clock, away, GRACE, hold, SKIPPED if self.may_lack else 0, self.aside)

    def lost_connections(self) -> Iterator[ConnectionLost]:
        """Yield the losses of connections from this computer whose processes have ended."""
        return ended_processes(self.central, is_rebooted=_was_booted(self.head))


def ended_processes(central: Central, *, is_rebooted: bool = False) -> Iterator[ConnectionLost]:
    """Yield the losses of connections from this computer whose processes have ended."""
    here, now = f"{socket.gethostname()}:", central.clock.now
    if not Path("/proc/self").exists():
        return
    for connection in list(central.restart_pause.awaited):
        process = connection.module.process
        pid = process.removeprefix(here)
        is_here = process.startswith(here) and pid.isdecimal()
        if is_here and (is_rebooted or not _is_running(pid)):
            why = "its process had ended when central came back"
            yield ConnectionLost(now, connection.id, why)


def _was_booted(head: Head) -> bool:
    """Whether the computer has rebooted since a segment's head was written."""
    return head.boot != this_boot()


def _is_running(process: str) -> bool:
    """Whether a process runs. A zombie does not."""
    try:
        state = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(") ")[2][:1]
    except OSError:
        return False
    return state not in ("Z", "X")


def unfinished_segments(folder: Path, *, accept: bool = False) -> list[InputSegment]:
    """Return the segments of inputs of a folder's newest run, oldest first; none if the run ended.

    With *accept*, segments with damaged heads are skipped. Raises CentralError.
    """
    if not accept:
        check_heads(folder)
    found = newest_run(folder)
    newest = None if accept else newest_segment(folder)
    if newest is not None and not newest_run(folder, newest[1]) and not is_closed(newest[0]):
        log.warning(
            "a new run starts, and the tasks of the last run in %s are lost: "
            "it is unfinished, and has no inputs (*%s) to continue with",
            folder,
            INPUT_SUFFIX,
        )
    return [] if found and has_ended(found) else found


def recover(
    folder: Path, segments: list[InputSegment], *, accept: bool = False, adopt: Adopt = bytes
) -> UnfinishedRun:
    """Return an unfinished run, replayed, with its logs cut so that new records can follow.

    Args:
        folder: The folder of the run.
        segments: The run's segments of inputs, from ``unfinished_segments``.
        accept: Whether to continue in spite of a difference to the journal.
        adopt: Gets each large body of the inputs and the image.

    Raises:
        CentralError: The run can't continue; the text says what to do.
    """
    head = segments[-1].head
    assert head is not None
    may_lack = head.sync is Sync.NONE or (head.sync is Sync.BATCH and _was_booted(head))
    try:
        replay = InputReplay(folder, segments, cuts=accept, may_lack=may_lack, adopt=adopt)
        facts = WrittenFacts(folder, replay.central.epoch, replay.central.event_count)
        missing: list[Entry] = []
        replayed = replay.entries()
        while (difference := facts.compare(replayed, missing)) is not None:
            if not accept and not (may_lack and difference.given is None):
                raise difference
            facts.move_aside(difference)
    except NoReplay as error:
        msg = f"{error}; --fresh starts a new run there"
        raise CentralError(msg) from None
    replay.cut_log()
    facts.cut_journal()
    if may_lack:
        what = (
            "the last inputs"
            if head.sync is Sync.NONE
            else "up to the last second before power was lost"
        )
        log.warning(
            "%s may be missing (--sync %s); %d entries of the journal, "
            "to which no input leads, were moved aside",
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
        replay.image_events,
        replay.image,
        facts.aside,
    )
