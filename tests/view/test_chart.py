"""The chart of the page: which rows it has, how to reach them, and in which colours."""

from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import Story
from view.conftest import Look

from tca_wire import facts
from tca_wire.points import TaskId

pytestmark = pytest.mark.slow


def crowded() -> Story:
    """Forty modules; a delivery has no handler, and another task is suspended."""
    story = Story()
    for number in range(40):
        story.module(f"module {number}", f"work {number}")
    story.at(1.0).queued(story.command("deliver", "user"))
    story.say(facts.SuspendedOrResumed(TaskId(story.command("mop", "user")), True))
    return story.at(2.0).acted(story.command("work 39", "user"), "module 39", 3.0)


def test_rows_below_the_edge_are_announced_and_reached(look: Look, tmp_path: Path) -> None:
    page = look(crowded().write(tmp_path / "crowd"))
    labels = "tca.chart.layout.filter(({ top, bottom }) => top >= 20 && bottom <= tca.chart.height).map(({ row }) => row.label)"
    seen = page.evaluate(labels)
    assert seen[:3] == ["(suspended)", "(no handler)", "module 0"]
    assert "module 39" not in seen
    below = page.locator("#chart-below")
    expect(below).to_have_text(f"▾ {42 - len(seen)} more rows below")
    below.click()
    expect(below).not_to_have_text(f"▾ {42 - len(seen)} more rows below")
    page.locator("#chart-bar").evaluate("(bar) => { bar.scrollTop = 100000; }")
    expect(below).to_be_hidden()
    assert page.evaluate(labels)[-1] == "module 39"
    page.set_viewport_size({"width": 1400, "height": 3000})
    expect(page.locator("#chart-bar")).to_be_hidden()
    assert page.evaluate(labels)[0] == "(suspended)"
