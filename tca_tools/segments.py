"""Which segments in a folder make one run: a folder may hold those of several, copies, and not all of a run."""

from pathlib import Path

from tca_tools.errors import UnusableLog
from tca_wire.errors import JournalDamaged
from tca_wire.facts import Opened
from tca_wire.journal import SEGMENT_SUFFIX, JournalReader

_MOST_NAMED = 3
"""Files that a line names."""


class Folder:
    """A folder of segments, of which those of one run are read: that of an epoch, or else the one that began last, when
    this is first asked.

    A segment that does not say whose it is (it is empty yet, or no journal) counts as one of the run; who reads it will
    see what it is.
    """

    def __init__(self, path: Path, epoch: str | None = None) -> None:
        self.path = path
        self._epoch = epoch
        self._openings: dict[Path, Opened] = {}

    def segments(self) -> list[Path]:
        """The segments of the run that there are now, oldest first."""
        paths = segments_in(self.path)
        self._look_into(paths)
        before = self._numbered_before()
        by_number: dict[tuple[float, str], Path] = {}
        for path in sorted(paths, key=_is_copy):
            opening = self._openings.get(path)
            if opening is None:
                if _number_in(path) > before:
                    by_number.setdefault((_number_in(path) - before, path.name), path)
            elif opening.epoch == self._epoch:
                by_number.setdefault((opening.segment, ""), path)
        return [by_number[number] for number in sorted(by_number)]

    def epochs(self) -> list[Opened]:
        """How the runs begin whose segments lie there, oldest first."""
        self._look_into(segments_in(self.path))
        first: dict[str, Opened] = {}
        for opening in sorted(self._openings.values(), key=lambda one: (one.began, one.segment)):
            first.setdefault(opening.epoch, opening)
        return list(first.values())

    def _numbered_before(self) -> int:
        """The last number of segments of earlier runs: central goes on with the next one."""
        mine = [(path, one.segment) for path, one in self._openings.items() if one.epoch == self._epoch]
        return max(0, min((int(path.stem) - number for path, number in mine if path.stem.isdecimal()), default=0))

    @property
    def others(self) -> list[str]:
        """A line for what lies there beside the run: segments of other runs, and copies."""
        shown = self.segments()
        left_out = [path for path in segments_in(self.path) if path in self._openings and path not in shown]
        others = [path for path in left_out if self._openings[path].epoch != self._epoch]
        copies = [path for path in left_out if path not in others]
        told = []
        if others:
            runs = 1 + len({self._openings[path].epoch for path in others})
            told.append(
                f"{self.path}: segments of {runs} runs lie there: this is the one that began last ({_names(shown)});"
                f" to see another, give its file ({_names(others)}), or move what is of one run to a folder of its own"
            )
        if copies:
            what = "is a segment" if len(copies) == 1 else "are segments"
            told.append(f"{self.path}: {_names(copies)} {what} that the run has already, and left out")
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
                which = f"segment {first} is" if number == first + 1 else f"segments {first} to {number - 1} are"
                told.append(f"{self.path}: {which} missing: what happened then is not known")
            first = number + 1
        return told

    def _look_into(self, paths: list[Path]) -> None:
        """Read how those begin that have not been read yet, and choose the run."""
        for path in paths:
            if path not in self._openings and (opening := _opening(path)) is not None:
                self._openings[path] = opening
        if self._epoch is None and self._openings:
            newest_first = sorted(self._openings.items(), key=lambda one: (one[1].began, one[0]))
            self._epoch = newest_first[-1][1].epoch


def segments_in(folder: Path) -> list[Path]:
    """All segments in a folder, by name. Raises UnusableLog if it can't be read."""
    return [path for path in listed(folder) if path.suffix == SEGMENT_SUFFIX]


def listed(folder: Path) -> list[Path]:
    """What is in a folder, by name. Raises UnusableLog if it can't be read."""
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
    return next((fact for fact in entry.facts if isinstance(fact, Opened)), None) if entry is not None else None


def _number_in(path: Path) -> float:
    """Which segment its name says that it is; those that do not say are the last."""
    return int(path.stem) if path.stem.isdecimal() else float("inf")


def _is_copy(path: Path) -> tuple[bool, str]:
    """Those with names that central gives come first."""
    return not path.stem.isdecimal(), path.name


def _names(paths: list[Path]) -> str:
    more = f" and {len(paths) - _MOST_NAMED} more" if len(paths) > _MOST_NAMED else ""
    return ", ".join(path.name for path in paths[:_MOST_NAMED]) + more
