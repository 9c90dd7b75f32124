"""Which runs of a folder are old or too much, and their removal. Knows files; knows nothing of what
facts mean.

A run goes as a whole, with the inputs and images of central's state that lie beside its segments.
What none of tca has written stays, and so do links: what lies elsewhere is pruned where it is.
"""

import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from tca_tools.errors import ToolError, UnusableLog
from tca_tools.journal.journals import is_closed, runs_in
from tca_tools.journal.segments import Folder, listed, segments_in
from tca_wire.endpoint import by_number, run_number


class StoredRun(NamedTuple):
    """A run as it lies on the disk."""

    name: str
    """As it is named as LOG."""
    folder: Path
    files: list[Path]
    """The last are its segments, oldest first."""
    size: int
    ended: float
    """When something was written last, in seconds since 1970."""
    kept: str
    """Why it stays whatever its age and size; "" if it need not."""


def stored_runs(folder: Path) -> list[StoredRun]:
    """The runs in a folder, or in the folders right in it, by their ends. Raises UnusableLog if
    there are none.
    """
    journals = (
        [folder]
        if segments_in(folder)
        else by_number(one for one in listed(folder) if _is_journal(one))
    )
    numbered = [journal for journal in journals if run_number(journal)]
    runs = _in_order([run for journal in numbered for run in _runs_in(journal)])
    for journal in journals[: len(journals) - len(numbered)]:
        runs += _in_order(list(_runs_in(journal)))
    runs.sort(key=lambda run: run.ended)
    if not runs:
        raise UnusableLog(f"{folder}: no runs lie there")
    crashed = next(
        (run for run in reversed(runs) if not run.kept and not is_closed(run.files[-1])), None
    )
    return [
        run if run is not crashed else run._replace(kept="ended without a goodbye: it may go on")
        for run in runs
    ]


def _in_order(runs: list[StoredRun]) -> list[StoredRun]:
    """Runs that follow each other, with ends in that order. A run whose clock showed an earlier
    time than one before it had no clock that knew the day: it may have ended as late as the next
    one, or now.
    """
    found, after = list[StoredRun](), time.time()
    for run, latest in reversed(
        [*zip(runs, accumulate((run.ended for run in runs), max), strict=True)]
    ):
        after = latest if run.ended == latest else max(after, latest)
        found.append(run._replace(ended=after))
    return found[::-1]


def _is_journal(path: Path) -> bool:
    with suppress(UnusableLog):  # not ours to read
        return path.is_dir() and not path.is_symlink() and bool(segments_in(path))
    return False


def _runs_in(journal: Path) -> Iterator[StoredRun]:
    runs = list(runs_in(journal))
    files = Folder(journal).files()  # listed last: a run that begins meanwhile has some
    for name, opened, log in runs:
        stats = [path.stat() for path in files[opened.epoch] if path.exists()]
        ended = max(one.st_mtime for one in stats)
        kept = "a central writes it" if log.is_being_written else ""
        yield StoredRun(
            name, journal, files[opened.epoch], sum(one.st_size for one in stats), ended, kept
        )


def superfluous(
    runs: list[StoredRun], keep: float | None, keep_bytes: float | None
) -> list[StoredRun]:
    """Those that ended more than *keep* seconds ago, and the oldest ones until the others have so
    many bytes; whether or not they must stay.
    """
    found, total = [], sum(run.size for run in runs)
    for run in runs:
        is_old = keep is not None and run.ended < time.time() - keep
        if is_old or (keep_bytes is not None and total > keep_bytes):
            found.append(run)
            total -= 0 if run.kept else run.size
    return found


def remove(run: StoredRun, *, with_folder: bool) -> None:
    """Remove the files of a run; its goodbye is the last to go, so that half of it is never taken
    for a run that may go on. *with_folder*: the folder, too, if nothing else is in it.
    """
    try:
        for path in run.files:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise ToolError(f"{error.filename}: can't be removed: {error.strerror}") from None
    if with_folder:
        with suppress(OSError):
            run.folder.rmdir()
