"""Details of the page: its first view, stable columns, legible names."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from tools.story import Story, stumbling

from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome
from view.conftest import OpenPage, until, written

pytestmark = pytest.mark.slow


def long_run() -> Story:
    """Return a story of forty moves of one second in sequence."""
    story = Story().module("legs", "move").at(1.0)
    for _ in range(40):
        story.acted(story.command("move", "user"), "legs", 1.0)
    return story


def day() -> Story:
    """Return a story of six walks of eight moves."""
    story = Story().module("planner", "walk").module("legs", "move").at(1.0)
    for _ in range(6):
        walk = story.goal("walk", "user")
        story.delivered(walk, "planner").returned(walk)
        for _ in range(8):
            story.acted(story.command("move", "planner", walk), "legs", 1.0)
    return story


@pytest.mark.soak
def test_ended_run_is_shown_from_its_first_task(open_page: OpenPage, tmp_path: Path) -> None:
    run, seen = day().say(facts.Closed("done")).write(tmp_path / "day"), ".row[data-task='{}']"
    page = open_page(run)
    expect(page.locator(seen.format(8))).to_be_in_viewport()
    assert page.evaluate("[tca.tree.rows.length, tca.tree.scroller.scrollTop]") == [54, 0]
    page.keyboard.press("End")  # the End key shows the end
    for place, task in (("", 54), ("#task=54", 54), ("#t=47.5", 53)):
        page = open_page(run, place) if place else page
        expect(page.locator(seen.format(task))).to_be_in_viewport()
    page = open_page(day().write(tmp_path / "killed"))  # not closed: the page opens at its end
    expect(page.locator(seen.format(54))).to_be_in_viewport()


@pytest.mark.soak
def test_future_bar_has_a_dark_name(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "walk", "turn").at(1.0)
    for name in ("walk", "turn"):
        story.acted(story.command(name, "user"), "legs", 10.0)
    page = open_page(story.say(facts.Closed("done")).write(tmp_path / "walk"), "#t=10.9")
    expect(page.locator("#clock")).to_have_text("10.900 s")
    assert {(text, colour) for text, colour in written(page) if text in ("walk", "turn")} == {
        ("walk", "#ffffff"),
        ("turn", "#1f2933"),
    }
    page.evaluate("tca.slider.setTime(1.001)")
    expect(page.locator("#clock")).to_have_text("1.001 s")
    until(page, "tca.chart.time === 1.001")
    assert ("walk", "#1f2933") in written(page)


def assert_axis_labels_are_free(page: Page) -> None:
    """Assert that the cursor does not cover a label. It is at 20 s, where a label is."""
    expect(page.locator("#clock")).to_have_text("20.000 s")
    blue = """(y) => {
      const { chart } = tca, [from, to] = chart.window, scale = devicePixelRatio;
      const x = chart.labelWidth + (20 - from) / (to - from) * (chart.width - chart.labelWidth);
      const { data } = chart.context.getImageData((x - 1) * scale, y * scale, 3, 1);
      return [0, 4, 8].some((at) => data[at + 3] > 200 && data[at + 2] - data[at] > 60);
    }"""
    assert [page.evaluate(blue, y) for y in (4, 10, 30)] == [False, False, True]


@pytest.mark.soak
def test_ended_run_without_failures_opens_fully_expanded(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().module("planner", "day", "walk").module("legs", "move").at(1.0)
    top = story.goal("day", "user", to="planner", begins=True)
    for _ in range(8):
        walk = story.goal("walk", "planner", top, to="planner", begins=True)
        story.returned(walk)
        for _ in range(8):
            story.acted(story.command("move", "planner", walk), "legs", 1.0)
        story.reached(walk, Moment.END_PLANNING, Moment.END_ACHIEVING)
    story.returned(top).reached(top, Moment.END_PLANNING, Moment.END_ACHIEVING)
    page = open_page(story.say(facts.Closed("done")).write(tmp_path / "day"))
    until(page, "tca.tree.rows.length > 1")
    shown, room = page.evaluate(
        "[tca.tree.rows.length, Math.floor(tca.tree.scroller.clientHeight / 24)]"
    )
    assert room - 8 < shown <= room
    expect(page.locator(".row[data-task='3']")).to_be_visible()  # a move of the first walk


@pytest.mark.soak
def test_failure_is_shown_once_with_data_when_it_has_no_text(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().module("legs", "walk", "move").at(1.0)
    walk = story.goal("walk", "user", to="legs", begins=True)
    move = story.command("move", "legs", walk, to="legs")
    story.at(2.0).returned(move, Outcome.FAILED, data={"leg": 4}).say(
        facts.Failed(move, "stuck", "")
    )
    for task in (move, walk):
        why = "failure 'stuck' of move {2} was not handled"
        story.say(facts.Killed(TaskId(task), why, failed=TaskId(move))).reached(task, *Moment)
    page = open_page(story.at(3.0).write(tmp_path / "stuck"), f"#task={move}")
    expect(page.locator(f".row[data-task='{move}'] .why")).to_have_text('failed: stuck {"leg": 4}')
    expect(page.locator("#task .lead")).to_have_text(
        ["stuck", "killed: no exception handler handled that"]
    )
    page.locator("#search").fill("stuck")  # the failed task before the killed one
    assert page.evaluate("[...tca.tree.found].map((task) => task.id)") == [move, walk]
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.keyboard.press("Home")  # not a key of the page while the help is open
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()
    expect(page.locator("#clock")).to_have_text("3.000 s")


def test_live_chart_shows_the_last_seconds_and_the_chosen_task(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(long_run().say(facts.Closed("done")).write(tmp_path / "moves"), "#t=20")
    assert_axis_labels_are_free(page)
    page.evaluate("tca.slider.setTime(38)")
    window = "tca.chart.window.map((time) => Math.round(time))"
    page.locator("#tree").focus()
    page.keyboard.press("l")
    until(page, f"String({window}) === '8,38'")
    expect(page.locator("#last")).to_have_value("30")
    page.evaluate("tca.slider.setTime(40)")
    until(page, f"String({window}) === '10,40'")
    page.evaluate("tca.slider.setTime(5)")  # fewer than 30 s before it
    until(page, f"String({window}) === '1,31'")
    page.locator("#last").select_option("5")
    page.keyboard.press("End")
    until(page, f"String({window}) === '36,41'")
    for task in (
        3,
        4,
    ):  # task 3 moves the chart, so that task 4 is in sight, too
        page.locator("#search").fill(str(task))
        page.keyboard.press("Enter")
    expect(page.locator("#task h2")).to_have_text("move {4}")
    expect(page.locator("#last")).to_have_value("part")
    page.keyboard.press("Escape")
    until(page, f"String({window}) === '2,7'")
    page.keyboard.press("f")
    until(page, f"String({window}) === '1,41'")
    page.evaluate("tca.slider.setTime(10.5)")
    page.locator("#tab-messages").click()
    places = "[...document.querySelectorAll('#messages .kind')].map((one) => Math.round(one.getBoundingClientRect().left))"
    until(page, f"{places}.length > 50")
    times = page.locator("#messages .time").all_inner_texts()
    assert {len(one.strip()) for one in times} == {7, 8}  # 9.000 s and 10.000 s
    assert len(set(page.evaluate(places))) == 1  # one column


def test_message_columns_name_sender_and_handler(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(stumbling().write(tmp_path / "walk"), "#t=1")
    page.locator("#tab-traffic").click()
    pairs, rows = page.locator("#traffic .pair"), page.locator("#traffic tr:not(.pair)")
    expect(pairs).to_have_text(
        [
            "user interface → gait planner11",
            "gait planner → gait planner11",
            "gait planner → perception11",
            "gait planner → not handled yet2–",
        ]
    )
    page.evaluate("tca.slider.setTime(Infinity)")
    expect(pairs.nth(1)).to_have_text("gait planner → gait planner20.4")  # 2 in 5 s
    expect(pairs).to_have_text(
        [
            re.compile("planner1"),
            re.compile("planner2"),
            re.compile("perception2"),
            re.compile("controller2"),
            re.compile("not handled yet3–"),
        ]
    )
    rows.get_by_text("move leg").first.click()
    expect(page.locator("#search")).to_have_value("move leg controller")
    assert page.evaluate("tca.tree.found.values().next().value.id") == 6
