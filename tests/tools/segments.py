"""Builders of journal segments, and readers of logs and of the remarks about them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tca_tools.journal.journals import Log
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import record

YESTERDAY, TODAY = 1_700_000_000.0, 1_700_086_400.0


def segment(
    path: Path, entries: list[Entry], epoch: str, number: int = 1, began: float = YESTERDAY
) -> Path:
    opening = Entry(
        0, entries[0].time, [facts.Opened(JOURNAL_VERSION, epoch, number, began, "0.1.0")]
    )
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(b"".join(map(record, [opening, *entries])))
    return path


def numbers(log: Log) -> list[int]:
    return [entry.number for entry in log if entry.number]


class EndOfTest(Exception):
    pass


def followed(log: Log, *happenings: Callable[[], object]) -> list[int]:
    """Return the numbers of the entries that a follower sees. At each wait of the follower, one
    happening is called.
    """
    left = list(happenings)

    def wait() -> None:
        if not left:
            raise EndOfTest
        left.pop(0)()

    seen: list[int] = []
    with pytest.raises(EndOfTest):  # noqa: PT012 - what came before the end counts
        for entry in log.follow(wait):
            seen.append(entry.number)  # noqa: PERF401
    return seen


def printed_remarks(log: Log, capsys: pytest.CaptureFixture[str]) -> list[str]:
    log.check()
    return capsys.readouterr().err.splitlines()
