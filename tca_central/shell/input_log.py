"""The log of inputs: what central received, in segments NNNNNNNN.tcai beside the journal's.

An image NNNNNNNN.tcas has the state at the start of the segment with the same number.
The newest image and the later inputs restore the state (recovery.py).
"""

import contextlib
import math
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import msgspec

from tca_central.events import Input
from tca_central.shell.log_writer import LogWriter, Sync, append, cut, files_of
from tca_wire.journal.frames import framed, has_record, payloads
from tca_wire.packets.headers import PROTOCOL_VERSION
from tca_wire.release import release

INPUT_SUFFIX = ".tcai"
IMAGE_SUFFIX = ".tcas"
DRAFT_SUFFIX = ".draft"
INPUT_VERSION = 2

_encode = msgspec.msgpack.Encoder().encode

BOOT = Path("/proc/sys/kernel/random/boot_id")


def this_boot() -> str:
    """Return the id of the computer's present boot; "" if the system has no such ids."""
    try:
        return BOOT.read_text().strip()
    except OSError:
        return ""


class Head(msgspec.Struct, frozen=True, array_like=True, tag="inputs"):
    """The first record of a segment."""

    version: int
    epoch: str
    central: str  #: the version of central
    is_first: bool  #: whether the run starts with this segment, from an empty state
    sync: Sync
    boot: str
    clock: float  #: central's time when the head was written
    wall: float  #: that time in seconds since 1970
    protocol: int = 0  #: the protocol version of the logged packets

    @property
    def is_readable(self) -> bool:
        """Whether this version can replay the inputs."""
        return (self.version, self.protocol) == (INPUT_VERSION, PROTOCOL_VERSION)


class Ended(msgspec.Struct, frozen=True, array_like=True, tag="end"):
    """The last record of a run that ended regularly."""

    why: str


_decode_head = msgspec.msgpack.Decoder(Head).decode
_decode_any = msgspec.msgpack.Decoder(Input | Ended).decode


class InputLog(LogWriter):
    """One run's log of inputs. Each image starts another segment."""

    longest = float("inf")
    beat = float("inf")

    def __init__(self, folder: Path, *, epoch: str, sync: Sync, clock: float | None = None) -> None:
        """*clock* is central's time in a run that continues, None in a new run."""
        self._head = Head(
            INPUT_VERSION,
            epoch,
            release(),
            clock is None,
            sync,
            this_boot(),
            clock or 0.0,
            0.0,
            PROTOCOL_VERSION,
        )
        super().__init__(folder, INPUT_SUFFIX, sync)

    def head(self) -> bytes:
        """Return the head of the next segment, which names the run."""
        head = msgspec.structs.replace(self._head, wall=time.time())
        self._head = msgspec.structs.replace(head, is_first=False)
        return framed(_encode(head))

    def add(self, event: Input) -> None:
        """Append an input; ``flush`` writes it."""
        self.add_record(framed(_encode(event)))

    def next_segment(self, clock: float) -> int:
        """Start another segment at central's time *clock*. Return its number.

        Raises CentralError.
        """
        self._head = msgspec.structs.replace(self._head, clock=clock)
        self.start_segment()
        return self.newest

    def use_image(self, number: int, previous: int) -> None:  # noqa: ARG002 - a shared log needs it
        """Remove the files before the *previous* image: image *number* is complete."""
        if previous:
            self.remove(previous)

    def standbys(self) -> None:
        """Return None: no central follows files."""

    def remove(self, before: float = math.inf) -> None:
        """Remove this run's files with numbers below *before*. Raises OSError.

        By default all files are removed, so that the run can't continue.
        """
        for suffix in (IMAGE_SUFFIX, INPUT_SUFFIX):
            for path in files_of(self.folder, suffix):
                if self.first <= int(path.stem) < before:
                    path.unlink(missing_ok=True)

    def end(self, why: str) -> None:
        """Write all records, then that the run has ended, and close the file."""
        self.add_record(framed(_encode(Ended(why))))
        self.close()


class InputSegment:
    """A segment to read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = int(path.stem)
        self.size = path.stat().st_size  #: the bytes of the file
        self.end = 0  #: the offset after the last sound record that was read
        self.head: Head | None = None  #: None: the head is damaged, or missing
        with path.open("rb") as stream, contextlib.suppress(msgspec.MsgspecError):
            for offset, payload in islice(payloads(stream), 1):
                self.head, self.end = _decode_head(payload), offset
        self._begin = self.end  #: the offset after the head

    @property
    def is_torn(self) -> bool:
        """Whether at most bytes of an interrupted write follow the last sound record."""
        with self.path.open("rb") as stream:
            stream.seek(self.end)
            return not has_record(stream.read())

    @property
    def is_empty(self) -> bool:
        """Whether it has no input: a failed start leaves such a segment."""
        return next(iter(self), None) is None and self.is_torn

    def write_end(self, why: str) -> None:
        """Write after the last sound record that the run has ended. Raises OSError."""
        for _ in self:
            pass
        cut(self.path, self.end)
        append(self.path, framed(_encode(Ended(why))))

    def __iter__(self) -> Iterator[Input | Ended]:
        """Yield its inputs, up to the first damaged record."""
        self.end = self._begin
        with self.path.open("rb") as stream:
            stream.seek(self._begin)
            for offset, payload in payloads(stream):
                try:
                    found = _decode_any(payload)
                except msgspec.MsgspecError:
                    return
                self.end = offset
                yield found
