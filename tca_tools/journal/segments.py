"""Find the segments of one run in a folder, which may contain several runs, copies, and gaps."""

from contextlib import suppress
from math import inf
from pathlib import Path

import msgspec

from tca_tools.errors import UnusableLog
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import Opened
from tca_wire.journal.frames import payloads
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader

_MOST_NAMED = 3
"""The number of files that a remark names."""
INPUT_SUFFIX = ".tcai"
_STATE_FILES = (".draft", ".tcas", f"{INPUT_SUFFIX}-aside", INPUT_SUFFIX)
"""Unfinished and finished images of central's state, and its inputs; numbered apart from segments.
"""
_ASIDE = f"{SEGMENT_SUFFIX}-aside"
"""Facts put aside since replaying the inputs did not produce them; numbered like segments."""


class Folder:
    """A folder of segments, from which one run is read: that of an epoch, or the newest.

    The newest run is the one with the highest file numbers: central continues the numbers of
    earlier runs in a folder. Wall-clock times decide only if the numbers do not, since the clock
    may have been set between the runs.

    A segment that does not name its run counts as one of this run. It is empty, or it is not a
    journal. Its reader reports the latter.
    """

    def __init__(self, path: Path, epoch: str | None = None) -> None:
        self.path = path
        self.epoch = epoch
        """The run's epoch; None while it is not known."""
        self._is_chosen = epoch is not None
        self._openings: dict[Path, Opened] = {}

    def segments(self) -> list[Path]:
        """Return the run's current segments, oldest first."""
        paths = segments_in(self.path)
        self._read_openings(paths)
        before = self._numbered_before()
        by_number: dict[tuple[float, str], Path] = {}
        # Copies come last: only the segments that central wrote are named by a number
        for path in sorted(paths, key=lambda path: not path.stem.isdecimal()):
            opening = self._openings.get(path)
            if opening is None:
                if _number_in(path) > before:
                    by_number.setdefault((_number_in(path) - before, path.name), path)
            elif opening.epoch == self.epoch:
                by_number.setdefault((opening.segment, ""), path)
        return [by_number[number] for number in sorted(by_number)]

    def epochs(self) -> list[Opened]:
        """Return the first fact of each run in the folder, oldest run first."""
        self._read_openings(segments_in(self.path))
        return self._in_order()

    def files(self) -> dict[str, list[Path]]:
        """Return all files of each run, by epoch: images of central's state, inputs, segments.

        Each kind is sorted oldest first. A file that does not name its run belongs to the run of
        the file with the same number, or with the next lower one.
        """
        paths = segments_in(self.path)
        self._read_openings(paths)
        paths += [
            path
            for path in listed(self.path)
            if path.suffix in (*_STATE_FILES, _ASIDE) and path.stem.isdecimal()
        ]
        found: dict[str, list[Path]] = {one.epoch: [] for one in self._in_order()}
        segments = [(_number_in(path), opening.epoch) for path, opening in self._openings.items()]
        inputs = [
            (_number_in(path), epoch)
            for path in paths
            if path.suffix == INPUT_SUFFIX
            if (epoch := _epoch_of(path))
        ]
        order = (*_STATE_FILES, _ASIDE, SEGMENT_SUFFIX)
        for path in sorted(
            paths, key=lambda path: (order.index(path.suffix), _number_in(path), path.name)
        ):
            opening = self._openings.get(path)
            known = (path.suffix in _STATE_FILES and inputs) or segments
            found.get(opening.epoch if opening else _nearest(known, path), []).append(path)
        return found

    def number_of(self, epoch: str) -> int:
        """Return the number of a run in the folder; the oldest is 1.

        Raises:
            UnusableLog: The folder does not contain the run.
        """
        epochs = [one.epoch for one in self.epochs()]
        if epoch not in epochs:
            raise UnusableLog(f"{self.path}: run {epoch} is no longer there")
        return 1 + epochs.index(epoch)

    def _in_order(self) -> list[Opened]:
        """Return the first fact of each run, oldest run first."""
        first: dict[str, Opened] = {}
        for opening in sorted(self._openings.values(), key=lambda one: one.segment):
            first.setdefault(opening.epoch, opening)
        before: dict[str, float] = {}  # by run: the last file number of earlier runs
        for path, one in self._openings.items():
            earlier = _number_in(path) - one.segment
            before[one.epoch] = min(before.get(one.epoch, inf), earlier)
        if inf in before.values():  # a file without a number
            return sorted(first.values(), key=lambda one: one.began)
        return sorted(first.values(), key=lambda one: (before[one.epoch], one.began))

    def _numbered_before(self) -> int:
        """Return the last segment number of earlier runs: central continues with the next one."""
        own = [
            (path, one.segment) for path, one in self._openings.items() if one.epoch == self.epoch
        ]
        numbered = [(int(path.stem), number) for path, number in own if path.stem.isdecimal()]
        return max(0, min((in_name - number for in_name, number in numbered), default=0))

    @property
    def others(self) -> list[str]:
        """Remarks on segments that are not read: those of other runs, and copies."""
        shown = self.segments()
        left_out = [
            path for path in segments_in(self.path) if path in self._openings and path not in shown
        ]
        others = [path for path in left_out if self._openings[path].epoch != self.epoch]
        copies = [path for path in left_out if path not in others]
        remarks = []
        if others and not self._is_chosen:
            runs = self.epochs()
            number = next(
                (place for place, one in enumerate(runs, 1) if one.epoch == self.epoch), len(runs)
            )
            another = f"{self.path}#{number - 1 or 2}"
            remarks.append(
                f"{self.path}: contains {len(runs)} runs; this is the one that started last "
                f"({_names(shown)}); to see another, name it, as in '{another}': "
                f"'tca log runs {self.path}' lists them"
            )
        if copies:
            are = "is a copy of a segment" if len(copies) == 1 else "are copies of segments"
            remarks.append(f"{self.path}: {_names(copies)} {are} of the run: left out")
        return remarks

    @property
    def missing(self) -> list[str]:
        """Remarks on segments of the run that are missing before later ones."""
        before = self._numbered_before()
        numbers = {
            self._openings[path].segment if path in self._openings else _number_in(path) - before
            for path in self.segments()
        }
        remarks, first = [], 1
        for number in sorted(int(one) for one in numbers if one < inf):
            if number > first:
                which = (
                    f"segment {first} is"
                    if number == first + 1
                    else f"segments {first} to {number - 1} are"
                )
                remarks.append(f"{self.path}: {which} missing: the events of that time are unknown")
            first = number + 1
        return remarks

    def _read_openings(self, paths: list[Path]) -> None:
        """Read the first facts of new segments; choose the run if none was chosen."""
        for path in paths:
            if path not in self._openings and (opening := _opening(path)) is not None:
                self._openings[path] = opening
        if self.epoch is None and self._openings:
            self.epoch = self._in_order()[-1].epoch


def segments_in(folder: Path) -> list[Path]:
    """Return all segments in a folder, sorted by name. Raises UnusableLog if it can't be read."""
    return [path for path in listed(folder) if path.suffix == SEGMENT_SUFFIX]


def listed(folder: Path) -> list[Path]:
    """Return the files in a folder, sorted by name. Raises UnusableLog if it can't be read."""
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise UnusableLog(f"{folder}: can't be read: {error.strerror}") from None


def _opening(path: Path) -> Opened | None:
    """Return the ``Opened`` fact of a segment; None if it has none."""
    try:
        with path.open("rb") as stream:
            entry = next(iter(JournalReader(stream, str(path))), None)
    except (OSError, JournalDamaged):
        return None
    facts = entry.facts if entry is not None else ()
    return next((fact for fact in facts if isinstance(fact, Opened)), None)


def _epoch_of(inputs: Path) -> str:
    """Return the epoch in the first frame of a file of inputs; "" if it has none."""
    with (
        suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError, LookupError, TypeError),
        inputs.open("rb") as file,
    ):
        for _, head in payloads(file):
            epoch = msgspec.msgpack.decode(head)[2]
            return epoch if isinstance(epoch, str) else ""
    return ""


def _nearest(known: list[tuple[float, str]], path: Path) -> str:
    """Return the epoch of the highest number up to a file's, else of the lowest number."""
    number = _number_in(path)
    return next(
        (epoch for one, epoch in sorted(known, reverse=True) if one <= number),
        min(known, default=(0, ""))[1],
    )


def _number_in(path: Path) -> float:
    """Return the number in a file's name; inf if it has none, so it is sorted last."""
    return int(path.stem) if path.stem.isdecimal() else inf


def _names(paths: list[Path]) -> str:
    more = f" and {len(paths) - _MOST_NAMED} more" if len(paths) > _MOST_NAMED else ""
    return ", ".join(path.name for path in paths[:_MOST_NAMED]) + more
