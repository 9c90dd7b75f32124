"""Journals of former versions, which every later version must read.

The journal of a released version never changes. If a fact changes before the release, remove the
file and run this test with ``--rewrite``, which creates a new one. Facts that later versions no
longer know are left out, and the last line of the transcript says so.
"""

import json
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import pytest
from click.testing import Result
from tools.runs import walk

from tca_tools.journal.journals import open_log
from tca_tools.log.fact_rows import fact_row
from tca_wire.constraints import Constraint
from tca_wire.journal import causes, facts
from tca_wire.journal.facts import JOURNAL_VERSION, OLDEST_READ, Entry
from tca_wire.journal.records import record
from tca_wire.points import Moment, Point, TaskId

GOLDEN = Path(__file__).parent / "golden"
WALK_ENTRIES = 40
"""The number of entries taken from a walk."""
TOOLS = ("tree", "gantt", "stats", "log show", "replay --text")


def sample_value(kind: Any) -> Any:
    """Return a value of a type that differs from the default."""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return list(kind)[-1]
    if get_origin(kind) is list:
        return [sample_value(get_args(kind)[0])]
    values: dict[Any, Any] = {
        int: 7,
        TaskId: 7,
        str: "süß",
        float: 0.25,
        bool: True,
        bytes: b"\xa3any",
    }
    values |= {Point: Point(TaskId(7), Moment.END_PLANNING)}
    values |= {Constraint: Constraint(values[Point], Point(TaskId(8), Moment.START_ACHIEVING), 1.5)}
    return values[kind] if kind in values else sample_value(get_args(kind)[0])


def one_of_each() -> Iterator[Entry]:
    """Yield an entry for each kind of fact and cause, with all fields filled."""
    last, time = walk()[WALK_ENTRIES - 1].number, walk()[WALK_ENTRIES - 1].time
    kinds = [kind for kind in get_args(facts.Fact) if kind is not facts.Opened]
    made: list[Any] = [
        kind(**{name: sample_value(what) for name, what in get_type_hints(kind).items()})
        for kind in kinds
    ]
    for number, fact in enumerate(made, last + 1):
        kind = get_args(causes.Cause)[number % 3]
        cause = kind(**{name: sample_value(what) for name, what in get_type_hints(kind).items()})
        yield Entry(number, time + number, [fact], cause)


@pytest.fixture
def current(rewrite: bool) -> Path:
    path = GOLDEN / f"{JOURNAL_VERSION}.tcaj"
    if rewrite and not path.exists():
        opened = facts.Opened(JOURNAL_VERSION, "golden", 1, 1_700_000_000.0, "0.1.0")
        entries = [Entry(0, 0.0, [opened]), *walk()[1:WALK_ENTRIES], *one_of_each()]
        path.write_bytes(b"".join(map(record, entries)))
    return path


def test_current_version_has_a_golden_journal(current: Path) -> None:
    assert current.exists(), "format of the journal changed: run this test with --rewrite"


@pytest.mark.parametrize("version", range(OLDEST_READ, JOURNAL_VERSION + 1))
def test_golden_journal_is_read_as_when_written(
    tca: Callable[..., Result], expect: Callable[[str, str], None], current: Path, version: int
) -> None:
    path = current.with_name(f"{version}.tcaj")
    if not path.exists():
        pytest.skip(f"nobody has kept a journal of version {version}")
    log = open_log(path)
    rows = [
        json.dumps(fact_row(entry, fact), ensure_ascii=False)
        for entry in log
        for fact in entry.facts
    ]
    remarks = [one.removeprefix(f"{path}, ") for one in log.remarks]
    expect(f"golden-{version}", "\n".join([*rows, *remarks]) + "\n")
    for tool in TOOLS:
        result = tca(*tool.split(), path)
        assert (result.exit_code, bool(result.stderr)) == (len(remarks), bool(remarks)), tool
    assert tca("check", path).exit_code in (0, 1)
