"""A central that ends changes nothing: why a run stands is told afterwards as it was live."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.story import QUERY, Story, arcs, locking, stumbling, walking
from tools.waits import stuck

from tca_wire.journal import facts
from tca_wire.points import TaskId

Tca = Callable[..., Result]


def asking() -> Story:
    """The handler of a goal waits for a question that nobody handles."""
    story = Story().module("shop", "restock").at(1.0)
    goal = story.goal("restock", "user")
    story.delivered(goal, "shop").at(2.0)
    question = story.received("ask supplier", QUERY, "shop", origin=goal)
    return story.queued(question).say(facts.WaitBegan("shop", goal, TaskId(question), 0))


@pytest.mark.parametrize("tale", [asking, stuck, walking, stumbling, locking, arcs])
def test_what_is_told_is_the_same(tale: Callable[[], Story], tca: Tca, tmp_path: Path) -> None:
    logs = [
        tale().at(20.0).say(*ended).write(tmp_path / name / "run")
        for name, ended in (("open", ()), ("closed", [facts.Closed("interrupted")]))
    ]
    first = min(tale().fold().tasks)
    for command in (["tree"], ["tree", "--story", first], ["gantt"], ["stats"]):
        there, closed = (tca(*command[:1], log, *command[1:]) for log in logs)
        assert there.exit_code == closed.exit_code == 0, closed.stderr
        assert closed.stdout == there.stdout
    for log in logs:
        assert tca("export", log, "-o", log.parent / "tables", "--to", "csv").exit_code == 0
    names = {path.name for path in (tmp_path / "open" / "tables").iterdir()}
    assert "messages.csv" in names
    for name in names - {"facts.csv", "events.csv"}:
        assert (tmp_path / "closed" / "tables" / name).read_text() == (tmp_path / "open" / "tables" / name).read_text()


def test_why_it_stands_is_said(tca: Tca, tmp_path: Path) -> None:
    log = asking().at(80.0).say(facts.Closed("interrupted")).write(tmp_path / "run")
    assert "waits for the reply to ask supplier {2}, which no module handles, for 78 s" in tca("tree", log).stdout
