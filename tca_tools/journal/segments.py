"""Which segments in a folder make one run: a folder may hold those of several, copies, and not all
of a run.
"""

from contextlib import suppress
from pathlib import Path

import msgspec

from tca_tools.errors import UnusableLog
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import Opened
from tca_wire.journal.frames import payloads
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader

_MOST_NAMED = 3
"""Files that a line names."""
_INPUTS = ".tcai"
_BESIDE = (".draft", ".tcas", f"{_INPUTS}-aside", _INPUTS)
"""Images of central's state, in the making and whole, and its inputs, with numbers of their own."""
_ASIDE = f"{SEGMENT_SUFFIX}-aside"
"""Facts that the inputs did not lead to, when the run went on all the same; with the numbers of
segments.
"""


class Folder:
    """A folder of segments, of which those of one run are read: that of an epoch, or else the one
    that began last, when this is first asked.

    Which began last the numbers of the files tell, since central numbers on in a folder where
    earlier runs lie: a wall clock may have been set in between. It counts only where the numbers
    are the same, or a run has none.

    A segment that does not say whose it is (it is empty yet, or no journal) counts as one of the
    run; who reads it will see what it is.
    """

    def __init__(self, path: Path, epoch: str | None = None) -> None:
        self.path = path
        self.epoch = epoch
        """Of the run; None while it is not known."""
        self._is_chosen = epoch is not None
        self._openings: dict[Path, Opened] = {}

    def segments(self) -> list[Path]:
        """The segments of the run that there are now, oldest first."""
        paths = segments_in(self.path)
        self._look_into(paths)
        before = self._numbered_before()
        by_number: dict[tuple[float, str], Path] = {}
        for path in sorted(
            paths, key=lambda path: not path.stem.isdecimal()
        ):  # copies last: central names by number
            opening = self._openings.get(path)
            if opening is None:
                if _number_in(path) > before:
                    by_number.setdefault((_number_in(path) - before, path.name), path)
            elif opening.epoch == self.epoch:
                by_number.setdefault((opening.segment, ""), path)
        return [by_number[number] for number in sorted(by_number)]

    def epochs(self) -> list[Opened]:
        """How the runs begin whose segments lie there, oldest first."""
        self._look_into(segments_in(self.path))
        return self._in_order()

    def files(self) -> dict[str, list[Path]]:
        """By epoch all files of each run: images of central's state, inputs, and segments, each
        oldest first. One that does not say whose it is lies beside those of its number, or of the
        nearest before.
        """
        paths = segments_in(self.path)
        self._look_into(paths)
        paths += [
            path
            for path in listed(self.path)
            if path.suffix in (*_BESIDE, _ASIDE) and path.stem.isdecimal()
        ]
        found: dict[str, list[Path]] = {one.epoch: [] for one in self._in_order()}
        segments = [(_number_in(path), opening.epoch) for path, opening in self._openings.items()]
        inputs = [
            (_number_in(path), epoch)
            for path in paths
            if path.suffix == _INPUTS
            if (epoch := _epoch_of(path))
        ]
        order = (*_BESIDE, _ASIDE, SEGMENT_SUFFIX)
        for path in sorted(
            paths, key=lambda path: (order.index(path.suffix), _number_in(path), path.name)
        ):
            opening = self._openings.get(path)
            known = (path.suffix in _BESIDE and inputs) or segments
            found.get(opening.epoch if opening else _nearest(known, path), []).append(path)
        return found

    def number_of(self, epoch: str) -> int:
        """Which of the runs there it is, from 1 on: the oldest is the first. Raises UnusableLog if
        it is not there.
        """
        epochs = [one.epoch for one in self.epochs()]
        if epoch not in epochs:
            raise UnusableLog(f"{self.path}: run {epoch} does not lie there any more")
        return 1 + epochs.index(epoch)

    def _in_order(self) -> list[Opened]:
        first: dict[str, Opened] = {}
        for opening in sorted(self._openings.values(), key=lambda one: one.segment):
            first.setdefault(opening.epoch, opening)
        before: dict[str, float] = {}
        for path, one in self._openings.items():
            before[one.epoch] = min(
                before.get(one.epoch, float("inf")), _number_in(path) - one.segment
            )
        has_numbers = all(number < float("inf") for number in before.values())
        return sorted(
            first.values(), key=lambda one: (before[one.epoch] if has_numbers else 0.0, one.began)
        )

    def _numbered_before(self) -> int:
        """The last number of segments of earlier runs: central goes on with the next one."""
        mine = [
            (path, one.segment) for path, one in self._openings.items() if one.epoch == self.epoch
        ]
        return max(
            0,
            min(
                (int(path.stem) - number for path, number in mine if path.stem.isdecimal()),
                default=0,
            ),
        )

    @property
    def others(self) -> list[str]:
        """A line for what lies there beside the run: segments of other runs, and copies."""
        shown = self.segments()
        left_out = [
            path for path in segments_in(self.path) if path in self._openings and path not in shown
        ]
        others = [path for path in left_out if self._openings[path].epoch != self.epoch]
        copies = [path for path in left_out if path not in others]
        told = []
        if others and not self._is_chosen:
            runs = self.epochs()
            number = next(
                (place for place, one in enumerate(runs, 1) if one.epoch == self.epoch), len(runs)
            )
            another = f"{self.path}#{number - 1 or 2}"
            told.append(
                f"{self.path}: {len(runs)} runs lie there: this is the one that began last ({_names(shown)});"
                f" to see another, name it, as in '{another}': 'tca log runs {self.path}' lists them"
            )
        if copies:
            what = "is a segment" if len(copies) == 1 else "are segments"
            told.append(
                f"{self.path}: {_names(copies)} {what} that the run has already, and left out"
            )
        return told

    @property
    def missing(self) -> list[str]:
        """A line for segments of the run that are not there, though later ones are."""
        before = self._numbered_before()
        numbers = {
            self._openings[path].segment if path in self._openings else _number_in(path) - before
            for path in self.segments()
        }
        told, first = [], 1
        for number in sorted(int(one) for one in numbers if one < float("inf")):
            if number > first:
                which = (
                    f"segment {first} is"
                    if number == first + 1
                    else f"segments {first} to {number - 1} are"
                )
                told.append(f"{self.path}: {which} missing: what happened then is not known")
            first = number + 1
        return told

    def _look_into(self, paths: list[Path]) -> None:
        """Read how those begin that have not been read yet, and choose the run."""
        for path in paths:
            if path not in self._openings and (opening := _opening(path)) is not None:
                self._openings[path] = opening
        if self.epoch is None and self._openings:
            self.epoch = self._in_order()[-1].epoch


def segments_in(folder: Path) -> list[Path]:
    """All segments in a folder, by name. Raises UnusableLog if it can't be read."""
    return [path for path in listed(folder) if path.suffix == SEGMENT_SUFFIX]


def listed(folder: Path) -> list[Path]:
    """The files in a folder, by name. Raises UnusableLog if it can't be read."""
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise UnusableLog(f"{folder}: can't be read: {error.strerror}") from None


def _opening(path: Path) -> Opened | None:
    """How a segment begins; None if it does not say."""
    try:
        with path.open("rb") as stream:
            entry = next(iter(JournalReader(stream, str(path))), None)
    except (OSError, JournalDamaged):
        return None
    return (
        next((fact for fact in entry.facts if isinstance(fact, Opened)), None)
        if entry is not None
        else None
    )


def _epoch_of(inputs: Path) -> str:
    """The run whose inputs a file has, which its first record says; "" if it does not."""
    with (
        suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError, LookupError, TypeError),
        inputs.open("rb") as file,
    ):
        for _, head in payloads(file):
            epoch = msgspec.msgpack.decode(head)[2]
            return epoch if isinstance(epoch, str) else ""
    return ""


def _nearest(known: list[tuple[float, str]], path: Path) -> str:
    """The run of the last number that is not after that of a file, or of the first one."""
    number = _number_in(path)
    return next(
        (epoch for one, epoch in sorted(known, reverse=True) if one <= number),
        min(known, default=(0, ""))[1],
    )


def _number_in(path: Path) -> float:
    """Which segment its name says that it is; those that do not say are the last."""
    return int(path.stem) if path.stem.isdecimal() else float("inf")


def _names(paths: list[Path]) -> str:
    more = f" and {len(paths) - _MOST_NAMED} more" if len(paths) > _MOST_NAMED else ""
    return ", ".join(path.name for path in paths[:_MOST_NAMED]) + more
