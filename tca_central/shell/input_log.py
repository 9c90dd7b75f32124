"""The log of inputs: all that central was told, as it came, in segments NNNNNNNN.tcai beside the
journal's.

An image of the state, NNNNNNNN.tcas, is the state at the beginning of the segment of that number.
Newest image and the inputs since give the state anew (recovery.py).
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
    """A name for the time since this machine has started; "" where it has none."""
    try:
        return BOOT.read_text().strip()
    except OSError:
        return ""


class Head(msgspec.Struct, frozen=True, array_like=True, tag="inputs"):
    """The first record of a segment."""

    version: int
    epoch: str
    central: str  #: its version
    is_first: bool  #: of its run, which begins with nothing
    sync: Sync
    boot: str
    clock: float  #: of central, at that time
    wall: float  #: seconds since 1970
    protocol: int = 0  #: of the packets that the inputs are

    @property
    def is_readable(self) -> bool:
        """Whether this version can handle the inputs again."""
        return (self.version, self.protocol) == (INPUT_VERSION, PROTOCOL_VERSION)


class Ended(msgspec.Struct, frozen=True, array_like=True, tag="end"):
    """The last record of a run that ended of its own will."""

    why: str


_decode_head = msgspec.msgpack.Decoder(Head).decode
_decode_any = msgspec.msgpack.Decoder(Input | Ended).decode


class InputLog(LogWriter):
    """One run's log of inputs. A segment ends with an image."""

    longest = float("inf")

    def __init__(self, folder: Path, *, epoch: str, sync: Sync, clock: float | None = None) -> None:
        """*clock*: central's, in a run that goes on; None: it begins."""
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
        """Each segment says which run it belongs to."""
        head = msgspec.structs.replace(self._head, wall=time.time())
        self._head = msgspec.structs.replace(head, is_first=False)
        return framed(_encode(head))

    def add(self, event: Input) -> None:
        """Take an input; ``flush`` writes it."""
        self.put(framed(_encode(event)))

    def next_segment(self, clock: float) -> int:
        """Begin another segment, at this time of central's; its number. Raises CentralError."""
        self._head = msgspec.structs.replace(self._head, clock=clock)
        self.turn_over()
        return self.newest

    def remove(self, before: float = math.inf) -> None:
        """Remove all that this run has *before* a number; without one it can't go on. Raises
        OSError.
        """
        for suffix in (IMAGE_SUFFIX, INPUT_SUFFIX):
            for path in files_of(self.folder, suffix):
                if self.first <= int(path.stem) < before:
                    path.unlink(missing_ok=True)

    def end(self, why: str) -> None:
        """Write the rest, and that it is all."""
        self.put(framed(_encode(Ended(why))))
        self.close()


class InputSegment:
    """A segment that is read. ``end`` is the place behind the last sound record; ``size`` that of
    the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = int(path.stem)
        self.size = path.stat().st_size
        self.end = 0
        self.head: Head | None = None
        with path.open("rb") as stream, contextlib.suppress(msgspec.MsgspecError):
            for place, payload in islice(payloads(stream), 1):
                self.head, self.end = _decode_head(payload), place
        self._begin = self.end

    @property
    def is_torn(self) -> bool:
        """Whether what follows the last sound record, if anything does, was being written: no
        record is in it.
        """
        with self.path.open("rb") as stream:
            stream.seek(self.end)
            return not has_record(stream.read())

    @property
    def is_empty(self) -> bool:
        """Whether it has no input, as a start that failed leaves it."""
        return next(iter(self), None) is None and self.is_torn

    def end_run(self, why: str) -> None:
        """Write that the run has ended, behind the last sound record. Raises OSError."""
        for _ in self:
            pass
        cut(self.path, self.end)
        append(self.path, framed(_encode(Ended(why))))

    def __iter__(self) -> Iterator[Input | Ended]:
        """Its inputs, up to the first record that is not sound."""
        self.end = self._begin
        with self.path.open("rb") as stream:
            stream.seek(self._begin)
            for place, payload in payloads(stream):
                try:
                    found = _decode_any(payload)
                except msgspec.MsgspecError:
                    return
                self.end = place
                yield found
