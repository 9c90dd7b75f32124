"""The same recovery by the daemon's own code, from real files: torn where the simulated disk has torn them."""

import random
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from simulation.disk import as_record, inputs_in

from tca_central.shell.input_log import IMAGE_SUFFIX, INPUT_SUFFIX, INPUT_VERSION, Head, this_boot
from tca_central.shell.log_writer import Sync
from tca_central.shell.recovery import UnfinishedRun, recover, unfinished
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, Opened
from tca_wire.journal.frames import framed
from tca_wire.journal.records import SEGMENT_SUFFIX, record

EPOCH, VERSION = "simulated", "0"
_MEMORY = Path("/dev/shm")


def recovered(
    log: bytes, image: tuple[bytes, int, int] | None, journal: list[Entry], dice: random.Random, *, is_behind: bool
) -> tuple[UnfinishedRun, int]:
    """The run that the daemon finds, and how many entries its journal had. *is_behind*: the inputs may be."""
    with TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as name:
        folder = Path(name)
        _write_inputs(folder, log, image)
        known = _write_journal(folder, journal, image[2] if image is not None else 0, dice)
        return recover(folder, unfinished(folder), accept=is_behind), known


def _write_inputs(folder: Path, log: bytes, image: tuple[bytes, int, int] | None) -> None:
    """One segment, or two with an image between; the tail is as it is."""
    inputs, _ = inputs_in(log)
    since = image[1] if image is not None else 0
    before = b"".join(map(as_record, inputs[:since]))
    assert log.startswith(before)
    (folder / f"00000001{INPUT_SUFFIX}").write_bytes(_head(is_first=True) + (before if since else log))
    if image is not None:
        (folder / f"00000002{INPUT_SUFFIX}").write_bytes(_head(is_first=False) + log[len(before) :])
        (folder / f"00000002{IMAGE_SUFFIX}").write_bytes(image[0])


def _head(*, is_first: bool) -> bytes:
    head = Head(INPUT_VERSION, EPOCH, VERSION, is_first, Sync.ALWAYS, this_boot(), 0.0, 0.0)
    return framed(msgspec.msgpack.encode(head))


def _write_journal(folder: Path, journal: list[Entry], least: int, dice: random.Random) -> int:
    """The journal may lack its last entries, and be torn; what an image includes it has."""
    opened = record(Entry(0, 0.0, [Opened(JOURNAL_VERSION, EPOCH, 1, 0.0, VERSION)]))
    records = [opened, *map(record, journal)]
    ends = [0]
    for one in records:
        ends.append(ends[-1] + len(one))
    size = dice.choice((ends[-1], dice.randint(ends[least + 1], ends[-1])))
    (folder / f"00000001{SEGMENT_SUFFIX}").write_bytes(b"".join(records)[:size])
    return sum(end <= size for _, end in pairwise(ends)) - 1
