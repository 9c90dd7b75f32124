"""Failures are found in the page: marks at the slider, keys from one to the next, and what failed under what."""

from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import Story
from view.conftest import Look

from tca_wire import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome

pytestmark = pytest.mark.slow


def recovered() -> Story:
    """A step fails at 2 s and is replanned; at 6 s a second one fails, and nobody deals with that."""
    story = Story().module("planner", "step").module("expert", "replan").at(1.0)
    step = story.goal("step", "user")
    story.delivered(step, "planner").at(2.0).returned(step, Outcome.FAILED).say(facts.Failed(step, "slip", "on ice"))
    replan = story.command("replan", "central")
    story.say(facts.Caught(TaskId(step), TaskId(replan), TaskId(step), 9)).delivered(replan, "expert")
    story.at(3.0).returned(replan).reached(replan, Moment.END_ACHIEVING).say(facts.Recovered(TaskId(step)))
    story.reached(step, *Moment).at(5.0)
    last = story.goal("step", "user")
    story.delivered(last, "planner").at(6.0).returned(last, Outcome.FAILED).say(facts.Failed(last, "slip", "again"))
    return story.reached(last, *Moment).at(8.0).say(facts.Closed("done"))


def test_handled_failures_are_marked_and_found_too(look: Look, tmp_path: Path) -> None:
    page = look(recovered().write(tmp_path / "walk"), "#t=0.5")
    expect(page.locator("#counts")).to_be_attached()
    for clock in ("2.000 s", "6.000 s"):
        page.keyboard.press("]")
        expect(page.locator("#clock")).to_have_text(clock)
        expect(page.locator("#task h2")).to_contain_text("step {")
    page.keyboard.press("[")
    expect(page.locator("#clock")).to_have_text("2.000 s")
    page.keyboard.press("End")
    expect(page.locator("#clock")).to_have_text("8.000 s")
    assert page.evaluate("tca.store.failures.map((one) => [one.time, tca.store.wasHandled(one)])") == [
        [2, True],
        [6, False],
    ]
    assert page.evaluate(
        """[2, 6].map((time) => {
      const { canvas, store } = tca.slider, scale = canvas.width / canvas.clientWidth;
      const x = 7 + (time - store.start) / (store.end - store.start) * (canvas.clientWidth - 14);
      const [red, green] = canvas.getContext("2d").getImageData(x * scale, (canvas.clientHeight - 8.5) * scale, 1, 1).data;
      return green > 100 ? "amber" : red > 150 ? "red" : "none";
    })"""
    ) == ["amber", "red"]
