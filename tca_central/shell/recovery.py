"""The state of a run that ended without a goodbye: newest image, and the inputs since, through ``Central.handle``.

What comes out is compared with the facts that the journal has. The journal may lack the last ones: they are written
anew. Any other difference is told and stops the recovery, unless it is to be accepted: then what the journal has from
there on is put aside.
"""

import logging
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tca_central.core import Central
from tca_central.errors import CentralError, ImageError
from tca_central.events import ConnectionLost, Input, Record, Restarted, Spared
from tca_central.image.decoder import decode
from tca_central.inputs import events_of
from tca_central.shell.input_log import IMAGE_SUFFIX, INPUT_SUFFIX, INPUT_VERSION, Ended, Head, InputSegment, this_boot
from tca_central.shell.log_writer import Sync, numbers
from tca_central.shell.written_facts import WrittenFacts
from tca_wire.journal.facts import Entry, Opened
from tca_wire.journal.frames import has_record

GRACE = 10.0
"""Seconds that modules have to come back."""

SKIPPED = 1_000_000
"""Numbers that are passed over where the last second of the inputs may be lost: some may have been given in it."""

log = logging.getLogger("tca.central")


@dataclass
class UnfinishedRun:
    """A run that can go on."""

    central: Central
    head: Head  #: of its newest segment of inputs
    first: int  #: the number of its first one
    opened: Opened | None = None  #: of the newest segment of its journal
    last: Entry = field(default_factory=lambda: Entry(0, 0.0, []))  #: the last entry of its journal
    missing: list[Entry] = field(default_factory=list)  #: entries that the journal lacks
    inputs: int = 0  #: number of those handled again
    ended: float = 0.0  #: wall-clock time of its last input

    def restarted(self, *, hold: bool) -> Restarted:
        """The event with which it goes on."""
        away = max(0.0, time.time() - self.ended)
        is_sure = self.head.sync is Sync.ALWAYS or (self.head.sync is Sync.BATCH and not self.was_booted)
        return Restarted(self.central.clock.now, away, GRACE, hold, 0 if is_sure else SKIPPED)

    @property
    def was_booted(self) -> bool:
        """Whether the machine has started anew since."""
        return self.head.boot != this_boot()

    def gone(self) -> Iterator[ConnectionLost]:
        """Those connections whose processes, on this machine, are no more."""
        here, now = f"{socket.gethostname()}:", self.central.clock.now
        for connection in list(self.central.awaited):
            process = connection.module.process
            pid = process.removeprefix(here)
            is_here = process.startswith(here) and pid.isdecimal()
            if is_here and (self.was_booted or not Path(f"/proc/{pid}").exists()) and Path("/proc/self").exists():
                yield ConnectionLost(now, connection.id, "its process had ended when central came back")


def unfinished(folder: Path) -> list[InputSegment]:
    """The segments of inputs of the newest run in a folder, oldest first; none if it has ended of its own will."""
    found: list[InputSegment] = []
    for number in reversed(numbers(folder, INPUT_SUFFIX)):
        segment = InputSegment(folder / f"{number:08d}{INPUT_SUFFIX}")
        if segment.head is None:
            if found:
                break
            continue  # central ended while it began it
        if found and segment.head.epoch != found[-1].head.epoch:  # type: ignore[union-attr]
            break
        found.append(segment)
        if segment.head.is_first:
            break
    found.reverse()
    return [] if found and _has_ended(found[-1]) else found


def _has_ended(segment: InputSegment) -> bool:
    last = None
    for last in segment:  # noqa: B007 - the last one is wanted
        pass
    return isinstance(last, Ended)


def recover(folder: Path, segments: list[InputSegment], *, accept: bool = False) -> UnfinishedRun:
    """The run whose inputs these are. With *accept* it goes on in spite of a difference. Raises CentralError."""
    head = segments[-1].head
    assert head is not None
    if head.version != INPUT_VERSION:
        raise _hopeless(folder, f"its inputs are of format {head.version}, this tca reads {INPUT_VERSION}")
    first = segments[0].number
    central, segments = _begin(folder, segments)
    run = UnfinishedRun(central, head, first)
    facts = WrittenFacts(folder, central.epoch, central.events, accept=accept)
    for event, spared in _with_spared(_inputs(segments, accept=accept)):
        run.inputs += 1
        for one in events_of(event, spared):
            try:
                effects = central.handle(one)
            except Exception as error:
                what = f"input {run.inputs} leads to an error of central's own ({type(error).__name__}: {error})"
                raise _hopeless(folder, what) from error
            run.missing += facts.missing(effect.entry for effect in effects if isinstance(effect, Record))
    facts.end()
    run.opened, run.last = facts.opened, facts.last
    run.ended = head.wall + central.clock.now - head.clock
    return run


def _begin(folder: Path, segments: list[InputSegment]) -> tuple[Central, list[InputSegment]]:
    """The newest state that can be had whole, and the segments that follow it."""
    first, why = segments[0], ""
    for number in reversed(numbers(folder, IMAGE_SUFFIX)):
        if number < first.number or number > segments[-1].number:
            continue
        try:
            central = decode((folder / f"{number:08d}{IMAGE_SUFFIX}").read_bytes())
        except (ImageError, OSError) as error:
            why = f"image {number}: {error}"
            log.warning("%s: an older one is used", why)
            continue
        segments = [segment for segment in segments if segment.number >= number]
        break
    else:
        central = _from_nothing(folder, first, why)
    if missing := set(range(segments[0].number, segments[-1].number)).difference(one.number for one in segments):
        raise _hopeless(folder, f"its inputs number {min(missing)} are missing")
    return central, segments


def _from_nothing(folder: Path, first: InputSegment, why: str) -> Central:
    assert first.head is not None
    if not first.head.is_first:
        raise _hopeless(folder, why or "its first inputs are gone, and there is no image of the state after them")
    return Central(first.head.epoch)


def _inputs(segments: list[InputSegment], *, accept: bool) -> Iterator[Input]:
    for segment in segments:
        for event in segment:
            if not isinstance(event, Ended):
                yield event
        if segment.end < segment.size:
            _check_tail(segment, is_last=segment is segments[-1], accept=accept)


def _check_tail(segment: InputSegment, *, is_last: bool, accept: bool) -> None:
    """Bytes behind the last sound input: what was being written. Raises CentralError if it is damage."""
    with segment.path.open("rb") as stream:
        stream.seek(segment.end)
        rest = stream.read()
    if accept or (is_last and not has_record(rest)):
        return
    msg = f"{segment.path}, byte {segment.end}: an input is damaged, and others follow it; --resume facts goes on with \
what is before it, --fresh begins anew"
    raise CentralError(msg)


def _with_spared(inputs: Iterator[Input]) -> Iterator[tuple[Input, int]]:
    """Each input with the index of the request in it that is to be spared (-1: none)."""
    before: Input | None = None
    for event in inputs:
        if before is not None and not isinstance(before, Spared):
            yield before, event.index if isinstance(event, Spared) else -1
        before = event
    if before is not None and not isinstance(before, Spared):
        yield before, -1


def _hopeless(folder: Path, why: str) -> CentralError:
    return CentralError(f"the run in {folder} can't go on: {why}; --fresh begins a new one there")
