"""The tree scrolls to the chosen or current task, but never away from where the reader has
scrolled.
"""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect
from tools.story import Story

from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome
from view.conftest import OpenPage

pytestmark = pytest.mark.slow

STEPS = 60
SLIP = 40
"""The step with a failed last move."""


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """Return the journal of steps of 10 s in sequence. In the last 5 s of each step, no handler
    runs.
    """
    story = Story().module("planner", "step").module("legs", "move")
    for step in range(STEPS):
        story.at(step * 10.0)
        parent = story.goal("step", "user")
        story.delivered(parent, "planner").reached(parent, Moment.START_ACHIEVING)
        moves = [story.command("move", "planner", parent) for _ in range(3)]
        story.returned(parent)
        for place, move in enumerate(moves):
            story.at(step * 10.0 + 1 + place).delivered(move, "legs").at(step * 10.0 + 1.5 + place)
            if step == SLIP and place == 2:
                story.returned(move, Outcome.FAILED).say(facts.Failed(move, "slip", "on ice"))
            else:
                story.returned(move).reached(move, Moment.END_ACHIEVING)
        story.at(step * 10.0 + 5)
        if step % 5 == 0:  # long runs of equal steps would be folded
            story.say(facts.Killed(TaskId(parent), "enough"))
        story.reached(parent, Moment.END_PLANNING, Moment.END_ACHIEVING)
    return story.write(tmp_path / "walk")


def chosen(page: Page) -> Locator:
    return page.locator(".row.chosen")


def on_slider(page: Page, share: float) -> None:
    box = page.locator("#slider").bounding_box()
    assert box
    page.mouse.click(box["x"] + box["width"] * share, box["y"] + box["height"] / 2)


def first_number(step: int) -> int:
    return step * 4 + 1


def test_jump_target_is_in_sight(open_page: OpenPage, walk: Path) -> None:
    page = open_page(walk, "#t=15")
    expect(page.locator(".row").first).to_be_visible()
    page.keyboard.press("]")
    expect(page.locator("#clock")).to_have_text(f"{SLIP * 10 + 3.5:.3f} s")
    expect(chosen(page)).to_have_attribute("data-task", str(first_number(SLIP) + 3))
    expect(chosen(page)).to_be_in_viewport()
    page.keyboard.press("Home")
    page.locator("#tree").focus()
    page.keyboard.press("]")
    expect(chosen(page)).to_be_in_viewport()
    page.evaluate("location.hash = '#t=15'")
    expect(page.locator("#clock")).to_have_text("15.000 s")
    assert_in_sight_after_click_on_bar(page)


def assert_in_sight_after_click_on_bar(page: Page) -> None:
    """Click on a bar of the future. Assert that its task comes into sight."""
    x, y = page.evaluate("""() => {
      Object.assign(tca.chart, { from: 580, to: 600 });
      tca.chart.draw();
      const { chart } = tca, place = chart.layout.find((one) => one.row.label === "legs");
      const span = place.row.handled.lists[0].at(-1), box = chart.canvas.getBoundingClientRect(), [from, to] = chart.window;
      const x = chart.labelWidth + (span.start + 0.2 - from) / (to - from) * (chart.width - chart.labelWidth);
      return [box.left + x, box.top + place.top + 6];
    }""")
    page.mouse.click(x, y)
    expect(chosen(page)).to_have_attribute("data-task", str(first_number(STEPS - 1) + 3))
    expect(chosen(page)).to_be_in_viewport()
    before = page.locator("#rows").evaluate("(rows) => rows.scrollTop")
    for _ in range(4):  # the chosen row does not move
        page.keyboard.press("ArrowRight")
    expect(chosen(page)).to_be_in_viewport()
    assert page.locator("#rows").evaluate("(rows) => rows.scrollTop") == before


@pytest.mark.soak
def test_failed_query_is_not_taken_for_the_chosen_task(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("eyes", "look").at(1.0)
    move = story.command("move", "user")
    query = story.at(2.0).received("look", MessageClass.QUERY, "user")
    story.delivered(query, "eyes").at(3.0).returned(query, Outcome.FAILED).say(
        facts.Failed(query, "blind", "")
    )
    page = open_page(story.write(tmp_path / "blind"), f"#t=2.5&task={move}")
    expect(chosen(page)).to_have_count(1)
    page.keyboard.press("]")
    expect(page.locator("#task h2")).to_have_text("look {2}")
    expect(chosen(page)).to_have_count(0)


@pytest.mark.soak
def test_idle_tree_follows_the_last_change_until_scrolled(open_page: OpenPage, walk: Path) -> None:
    page = open_page(walk)
    assert_scrolled_place_is_kept_until_asked(page)
    for share in (0.5, 0.999):
        on_slider(page, share)
        expect(page.locator("#follow")).to_have_class("on" if share > 0.9 else "")
        step = page.evaluate("tca.tree.store.countSent(tca.store.top, tca.slider.time)") - 1
        assert step > 10  # below the first window
        expect(page.locator(f".row[data-task='{first_number(step)}']")).to_be_in_viewport()
    address, task = page.url.split("#")[0], first_number(30) + 2
    page.evaluate(f"location.assign('{address}#t=302.2&task={task}')")  # pasted into the open page
    expect(page.locator("#clock")).to_have_text("302.200 s")
    expect(chosen(page)).to_have_attribute("data-task", str(task))
    expect(chosen(page)).to_be_in_viewport()
    expect(page.locator("#task h2")).to_have_text(f"move {{{task}}}")
    page.evaluate(f"location.assign('{address}#task=1')")  # without a time: the end
    expect(page.locator("#follow")).to_have_class("on")
    expect(chosen(page)).to_have_attribute("data-task", "1")
    expect(chosen(page)).to_be_in_viewport()


def assert_scrolled_place_is_kept_until_asked(page: Page) -> None:
    on_slider(page, 0.5)
    page.locator("#rows").hover()
    page.mouse.wheel(0, -100_000)
    first = page.locator(".row[data-task='1']")
    expect(first).to_be_in_viewport()
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft"):
        page.keyboard.press(key)
        expect(first).to_be_in_viewport()
    on_slider(page, 0.7)
    expect(first).not_to_be_in_viewport()
    page.locator("#speed").select_option("100")
    page.locator("#play").click()
    page.locator("#rows").hover()
    while page.evaluate(
        "tca.tree.followsCurrent || tca.tree.scroller.scrollTop"
    ):  # new rows scroll a bit
        page.mouse.wheel(0, -100_000)
    expect(page.locator("#play")).to_have_text("▶")  # played to its end
    expect(first).to_be_in_viewport()


@pytest.mark.soak
def test_newest_wait_is_in_sight_when_everything_waits(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("planner", "step")
    for number in range(50):
        task = story.at(float(number)).command("open door", "user")
        if number % 2:
            story.queued(task)
    page = open_page(story.write(tmp_path / "waiting"))
    expect(page.locator(".row[data-task='50']")).to_be_in_viewport()
    expect(page.locator(".row[data-task='1']")).not_to_be_in_viewport()
    on_slider(page, 0.6)
    expect(page.locator(".row[data-task='29']")).to_be_in_viewport()


@pytest.mark.soak
def test_header_names_the_hidden_ancestors_of_visible_rows(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().module("planner", "day", "visit").module("legs", "move").at(1.0)
    day = story.goal("day", "user")
    story.delivered(day, "planner").reached(day, Moment.START_ACHIEVING)
    for _ in range(4):
        visit = story.goal("visit", "planner", day)
        story.delivered(visit, "planner").reached(visit, Moment.START_ACHIEVING)
        moves = [story.command("move", "planner", visit) for _ in range(12)]
    story.delivered(moves[-1], "legs")  # current: the page opens there
    page = open_page(story.at(2.0).write(tmp_path / "day"))
    head = page.locator(".heads span").first
    expect(page.locator(f".row[data-task='{moves[-1]}']")).to_be_visible()
    expect(head).to_have_text(re.compile(rf"^day {day} ▸ visit (\d+) ▸ $"))
    head.locator("button").last.click()
    expect(chosen(page)).to_contain_text("visit")
    head.locator("button").first.click()
    expect(chosen(page)).to_contain_text("day")
    expect(head).to_have_text("task")
