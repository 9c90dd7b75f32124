"""Find and remove old runs in a folder. This file handles files, and does not read facts.

A run is removed as a whole, with the inputs and images of central's state beside its segments.
Links stay, and so do files that tca has not written.
"""

import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import accumulate
from pathlib import Path
from shutil import rmtree
from typing import NamedTuple

from tca_tools.errors import ToolError, UnusableLog
from tca_tools.journal.journals import is_closed, runs_in
from tca_tools.journal.segments import Folder, listed, segments_in
from tca_wire.endpoint import by_number, run_number
from tca_wire.packets.large import DATA_FOLDER, HELD_FOLDER


class StoredRun(NamedTuple):
    """A run on the disk."""

    name: str
    """The name that LOG accepts."""
    folder: Path
    files: list[Path]
    """The last are its segments, oldest first."""
    data: list[Path]
    """The folders with its large data."""
    size: int
    """In bytes."""
    ended: float
    """The time of the last write, in seconds since 1970."""
    why_retained: str
    """The reason why it stays whatever its age and size; "" if it may be removed."""


def stored_runs(folder: Path) -> list[StoredRun]:
    """Return the runs in a folder, or in its direct subfolders, ordered by their ends.

    Raises UnusableLog if there are none.
    """
    journals = (
        [folder]
        if segments_in(folder)
        else by_number(one for one in listed(folder) if _is_journal(one))
    )
    numbered = [journal for journal in journals if run_number(journal)]
    runs = _with_ends_in_order([run for journal in numbered for run in _runs_in(journal)])
    for journal in journals[: len(journals) - len(numbered)]:
        runs += _with_ends_in_order(list(_runs_in(journal)))
    runs.sort(key=lambda run: run.ended)
    if not runs:
        raise UnusableLog(f"{folder}: no runs are stored there")
    open_runs = (run for run in reversed(runs) if not run.why_retained)
    unfinished = next((run for run in open_runs if not is_closed(run.files[-1])), None)
    return [
        run._replace(why_retained="unfinished: it may continue") if run is unfinished else run
        for run in runs
    ]


def _with_ends_in_order(runs: list[StoredRun]) -> list[StoredRun]:
    """Return successive runs with their ends corrected to the same order.

    If a run seems to have ended before an earlier run, the machine's clock was wrong. Such a run
    may have ended as late as the next run, or just now.
    """
    found, after = list[StoredRun](), time.time()
    for run, latest in reversed(
        [*zip(runs, accumulate((run.ended for run in runs), max), strict=True)]
    ):
        after = latest if run.ended == latest else max(after, latest)
        found.append(run._replace(ended=after))
    return found[::-1]


def _is_journal(path: Path) -> bool:
    with suppress(UnusableLog):  # without the permission to read it
        return path.is_dir() and not path.is_symlink() and bool(segments_in(path))
    return False


def _runs_in(journal: Path) -> Iterator[StoredRun]:
    runs = list(runs_in(journal))
    files = Folder(journal).files()  # listed last, so a run that has just started has files
    for name, opened, log in runs:
        stats = [path.stat() for path in files[opened.epoch] if path.exists()]
        ended = max(one.st_mtime for one in stats)
        why_retained = "a central writes it" if log.is_being_written else ""
        data = [journal / kind / opened.epoch for kind in (DATA_FOLDER, HELD_FOLDER)]
        size = sum(one.st_size for one in stats) + sum(map(_bytes_in, data))
        yield StoredRun(name, journal, files[opened.epoch], data, size, ended, why_retained)


def _bytes_in(folder: Path) -> int:
    """Return the bytes of all files below a folder, which may be missing."""
    total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):  # a central has just removed it
            total += path.stat().st_size if path.is_file() else 0
    return total


def superfluous(
    runs: list[StoredRun], keep: float | None, keep_bytes: float | None
) -> list[StoredRun]:
    """Return the runs that ended more than *keep* seconds ago, or exceed *keep_bytes* bytes.

    The oldest ones count as exceeding. Some of these runs may have to stay: see ``why_retained``.
    """
    found, total = [], sum(run.size for run in runs)
    for run in runs:
        is_old = keep is not None and run.ended < time.time() - keep
        if is_old or (keep_bytes is not None and total > keep_bytes):
            found.append(run)
            total -= 0 if run.why_retained else run.size
    return found


def remove(run: StoredRun, *, with_folder: bool) -> None:
    """Remove the files of a run, and if *with_folder* is set its folder, if that is empty then.

    The last segment goes last: it marks the run as closed, so the rest is never continued.
    """
    try:
        for folder in run.data:
            if folder.exists():
                rmtree(folder)
                with suppress(OSError):
                    folder.parent.rmdir()
        for path in run.files:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise ToolError(f"{error.filename}: can't be removed: {error.strerror}") from None
    if with_folder:
        with suppress(OSError):
            run.folder.rmdir()
