"""Replays a run's inputs: reads the newest run's segments in a folder, starting with an image."""

import logging
from collections.abc import Iterator
from pathlib import Path

from tca_central.core import Central
from tca_central.errors import CentralError, ImageError
from tca_central.events import Input, Record, RequestSkipped
from tca_central.image.decoder import decode
from tca_central.inputs import Adopt, events_of
from tca_central.shell.input_log import (
    DRAFT_SUFFIX,
    IMAGE_SUFFIX,
    INPUT_SUFFIX,
    INPUT_VERSION,
    Ended,
    InputSegment,
)
from tca_central.shell.log_writer import cut, files_of, move_aside, numbers, sync_path
from tca_wire.journal.facts import Entry
from tca_wire.packets.headers import PROTOCOL_VERSION

log = logging.getLogger("tca.central")


def newest_run(folder: Path, epoch: str = "") -> list[InputSegment]:
    """Return the segments of inputs of a folder's newest run, or of run *epoch*, oldest first."""
    found: list[InputSegment] = []
    for segment in map(InputSegment, reversed(files_of(folder, INPUT_SUFFIX))):
        if segment.head is None:
            if found:  # else central ended while creating it
                found.append(segment)  # ``InputReplay`` decides about the gap
            continue
        if segment.head.epoch != (epoch := epoch or segment.head.epoch):
            if found:
                break
            continue
        if not found and _is_left_over(segment):
            continue
        found.append(segment)
        if segment.head.is_first:
            break
    while found and found[-1].head is None:
        found.pop()
    return found[::-1]


def _is_left_over(segment: InputSegment) -> bool:
    """Whether a segment was left by a failed start.

    Such a segment is ignored: its head may name a later boot than that of the run's last input.
    """
    assert segment.head is not None
    is_used = segment.head.is_first or segment.path.with_suffix(IMAGE_SUFFIX).exists()
    return not is_used and segment.is_empty


def check_heads(folder: Path) -> None:
    """Raise CentralError if the newest head is damaged, so that the newest run is unknown."""
    for segment in map(InputSegment, reversed(files_of(folder, INPUT_SUFFIX))):
        if segment.head is not None:
            return
        if not segment.is_torn:
            raise _damaged(segment)


def has_ended(segments: list[InputSegment]) -> bool:
    """Whether a run ended regularly."""
    last = None
    for last in segments[-1]:  # noqa: B007 - the last one is wanted
        pass
    return isinstance(last, Ended)


class NoReplay(CentralError):
    """The error for inputs that are missing, or can't be replayed."""


class InputReplay:
    """A replay: central, and the inputs that it has yet to handle.

    Args:
        folder: The folder of the run.
        segments: The run's segments of inputs, oldest first.
        cuts: Whether to stop at a damaged or missing input instead of raising an error.
        may_lack: Whether some of the last inputs may not have reached the disk.
        from_first: Whether to start with the run's oldest state, not with the newest image.
        adopt: Gets each large body of the inputs and the image.

    Raises:
        CentralError: The inputs can't be replayed.
    """

    def __init__(
        self,
        folder: Path,
        segments: list[InputSegment],
        *,
        cuts: bool,
        may_lack: bool = False,
        from_first: bool = False,
        adopt: Adopt = bytes,
    ) -> None:
        self._adopt = adopt
        head = segments[0].head
        assert head is not None
        self.folder = folder
        self.head = head
        self.inputs = 0  #: the number of inputs replayed so far
        self._cuts, self._may_lack = cuts, may_lack
        self._last = segments[0]  #: the segment with the last input that was read
        if other := next(
            (one.head for one in segments if one.head is not None and not one.head.is_readable),
            None,
        ):
            what = (
                f"tca {other.central} wrote them, of format {other.version}.{other.protocol}, "
                f"and this tca reads only {INPUT_VERSION}.{PROTOCOL_VERSION}: "
                f"finish the run with tca {other.central}"
            )
            raise self._no_replay(what)
        self.central, self._segments = self._first_state(segments, from_first=from_first)
        self.image_events = self.central.event_count  #: the number of events that led to the image
        self.image = self._segments[0].number  #: the number of the image

    def entries(self) -> Iterator[Entry]:
        """Replay the inputs, and yield the entries to which they lead. Raises CentralError."""
        for logged, spared in with_spared(self._inputs()):
            self.inputs += 1
            for event in events_of(logged, spared, self._adopt):
                try:
                    effects = self.central.handle(event)
                except Exception as error:
                    what = f"{type(error).__name__}: {error}"
                    why = f"input {self.inputs} leads to an internal error of central ({what})"
                    raise self._no_replay(why) from error
                yield from (effect.entry for effect in effects if isinstance(effect, Record))

    def _first_state(
        self, segments: list[InputSegment], *, from_first: bool
    ) -> tuple[Central, list[InputSegment]]:
        """Return the newest (*from_first*: oldest) readable state, and the segments after it."""
        first, last, why = segments[0].number, segments[-1].number, ""
        images = [one for one in numbers(self.folder, IMAGE_SUFFIX) if first <= one <= last]
        if not (from_first and self.head.is_first):
            for number in images if from_first else images[::-1]:
                try:
                    image = (self.folder / f"{number:08d}{IMAGE_SUFFIX}").read_bytes()
                    central = decode(image, self._adopt)
                except (ImageError, OSError) as error:
                    why = f"image {number}: {error}"
                    log.warning("%s: central uses another image", why)
                    # The image was on the disk, so the inputs before it must be on the disk, too.
                    self._may_lack = False
                    continue
                return central, [segment for segment in segments if segment.number >= number]
        if not self.head.is_first:
            raise self._no_replay(
                why
                or "its first inputs were removed, and there is no image of the state after them"
            )
        return Central(self.head.epoch), segments

    def _inputs(self) -> Iterator[Input]:
        """Yield the inputs of all segments, up to the first damaged or missing one.

        Raises CentralError if no crash of central or its computer explains the damage.
        """
        for number, segment in enumerate(self._segments, self._segments[0].number):
            if segment.number > number:
                if self._cuts or self._may_lack:
                    return
                raise self._no_replay(f"its inputs number {number} are missing")
            if segment.head is not None:
                self._last = segment
            for event in segment:
                if not isinstance(event, Ended):
                    yield event
            if segment.head is not None and segment.end == segment.size:
                continue
            is_end = segment is self._segments[-1] or self._may_lack
            if not self._cuts and not (is_end and segment.is_torn):
                raise _damaged(segment)
            return

    def cut_log(self) -> None:
        """Cut the log after the last input that was read: new records must follow a sound record.

        Raises OSError.
        """
        last, later = self._last, list[Path]()
        for suffix in (INPUT_SUFFIX, IMAGE_SUFFIX, DRAFT_SUFFIX):
            for path in files_of(self.folder, suffix):
                is_later = int(path.stem) > last.number
                if suffix == INPUT_SUFFIX and is_later and not InputSegment(path).is_empty:
                    later.append(path)
                elif is_later or suffix == DRAFT_SUFFIX:
                    # It is from a failed start, or an image of a later state, or a partial image.
                    path.unlink()
        if later or not last.is_torn:
            move_aside(last.path, last.end, *later)
        sync_path(self.folder)
        for path in files_of(self.folder, INPUT_SUFFIX):
            # New records build on these segments, which a killed central may not have synced.
            if int(path.stem) >= self._segments[0].number:
                sync_path(path)
        cut(last.path, last.end)

    def _no_replay(self, why: str) -> "NoReplay":
        return NoReplay(f"the inputs in {self.folder} can't be handled again: {why}")


def _damaged(segment: InputSegment) -> CentralError:
    """Return the error for a damaged input before sound ones: no interrupted write causes that."""
    msg = (
        f"{segment.path}, byte {segment.end}: an input is damaged, and others follow it; "
        "--resume facts continues from the inputs before it, --fresh starts a new run"
    )
    return CentralError(msg)


def with_spared(inputs: Iterator[Input]) -> Iterator[tuple[Input, int]]:
    """Yield each input, and the index of its request that the replay must refuse (-1: none).

    A ``RequestSkipped`` after the input has this index.
    """
    previous: Input | None = None
    for event in inputs:
        if previous is not None and not isinstance(previous, RequestSkipped):
            yield previous, event.index if isinstance(event, RequestSkipped) else -1
        previous = event
    if previous is not None and not isinstance(previous, RequestSkipped):
        yield previous, -1
