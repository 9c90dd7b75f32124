"""What is waited for in the end, on the page: on every row, in the pane, and in the head for all tasks together."""

import re
import time
from pathlib import Path

import pytest
from playwright.sync_api import Route, expect
from tools.story import THIS, Story
from tools.waits import delayed, stuck
from view.conftest import Look

from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome

pytestmark = pytest.mark.slow

END = "in the end for calibrate {3}, which no module handles"


def test_every_row_that_waits_says_for_what_in_the_end(look: Look, tmp_path: Path) -> None:
    page = look(stuck().write(tmp_path / "stuck"), "#task=6")
    page.set_viewport_size({"width": 2200, "height": 860})
    why = {number: page.locator(f".row[data-task='{number}'] .why") for number in range(1, 7)}
    expect(why[1]).to_have_text(
        f"waits until drill {{2}}, drill {{4}}, drill {{5}} and 1 more are achieved, for 3.00 s; {END}"
    )
    expect(why[2]).to_have_text("waits until calibrate {3} is achieved, for 3.00 s; no module handles that")
    expect(why[3]).to_have_text("waits for a module that handles calibrate, for 3.00 s")
    expect(why[6]).to_have_text(f"waits until drill {{5}} is achieved, for 3.00 s; {END}")
    expect(page.locator("#task .lead.end")).to_have_text(END)
    page.set_viewport_size({"width": 1300, "height": 860})
    expect(why[6]).to_have_text("until drill {5} is achieved, for 3.00 s; in the end for calibrate {3}")
    expect(why[2]).to_have_text("until calibrate {3} is …, for 3.00 s; no module handles that")
    page.locator("#task .lead.end button").click()
    expect(page.locator("#task h2")).to_have_text("calibrate {3}")


def test_the_head_counts_by_what_is_waited_for_in_the_end(look: Look, tmp_path: Path) -> None:
    page = look(stuck().write(tmp_path / "stuck"))
    causes = page.locator("#causes")
    expect(causes).to_have_text("6 wait for 1 thing:calibrate {3}, which no module handles")
    page.keyboard.press("Home")
    expect(causes).to_have_text("nothing waits")
    page.keyboard.press("End")
    causes.locator("button").click()
    expect(page.locator("#task h2")).to_have_text("calibrate {3}")


def in_turn() -> Story:
    """Three tasks, one after the other: the second one begins when the first has ended, at 2 s."""
    tale = Story().module("arm", "lift").at(1.0)
    first = tale.command("lift", "user")
    second = tale.command("lift", "user", 0, sequential_achievement(TaskId(first), THIS))
    tale.command("lift", "user", 0, sequential_achievement(TaskId(second), THIS))
    tale.delivered(first, "arm").at(2.0).returned(first).reached(first, *Moment).delivered(second, "arm")
    return tale.at(3.0)


def test_nothing_that_has_ended_is_blamed_until_the_news_come(look: Look, tmp_path: Path) -> None:
    page = look(in_turn().write(tmp_path / "lifts"), "#t=1.5")
    page.set_viewport_size({"width": 2200, "height": 860})
    second, third = (page.locator(f".row[data-task='{number}'] .why") for number in (2, 3))
    causes = page.locator("#causes")
    expect(second).to_contain_text("until lift {1} is achieved")
    expect(third).to_contain_text("until lift {2} is achieved, for 500 ms; in the end for lift {1}, which arm handles")
    expect(causes).to_contain_text("lift {1}, which arm handles")
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    for what in ("notes", "causes"):
        page.route(f"**/api/{what}*", hold)  # no answer comes for a while
    page.keyboard.press("End")
    expect(page.locator(".row[data-task='1']")).to_have_class(re.compile("achieved"))
    assert "lift {1}" not in second.inner_text()
    expect(third).to_have_text("waits until lift {2} is achieved, for 2.00 s")
    expect(causes).to_have_text("2 wait for 1 thing:lift {1}, which arm handlesas of 1.500 s")
    late = time.monotonic() + 30
    while len(held) < 2:
        assert time.monotonic() < late, "the page asks for notes and causes"
        page.wait_for_timeout(10)
    for route in held:
        route.continue_()
    expect(causes).to_have_text("1 waits for 1 thing:lift {2}, which arm handles")


def test_a_wait_that_has_just_begun_has_lasted_for_no_time(look: Look, tmp_path: Path) -> None:
    page = look(in_turn().write(tmp_path / "lifts"), "#t=1.0&task=3")
    page.set_viewport_size({"width": 2200, "height": 860})
    why, lead = page.locator(".row[data-task='3'] .why"), page.locator("#task .lead").first
    end = "in the end for lift {1}, which arm handles"
    expect(why).to_have_text(f"waits until lift {{2}} is achieved; {end}")
    expect(lead).to_have_text("waits until lift {2} is achieved")
    page.keyboard.press("End")
    expect(why).to_have_text("waits until lift {2} is achieved, for 2.00 s")
    expect(lead).to_have_text("waits until lift {2} is achieved, for 2.00 s")


def test_what_was_told_of_a_moment_far_away_is_not_shown_meanwhile(look: Look, tmp_path: Path) -> None:
    """Nothing waits at the beginning: that stood at the end until the next answer came."""
    page = look(in_turn().at(90.0).module("late").write(tmp_path / "lifts"), "#t=0.5")
    causes = page.locator("#causes")
    expect(causes).to_have_text("nothing waits")
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    page.route("**/api/causes*", hold)
    page.keyboard.press("End")
    expect(causes).to_have_text("what is waited for is being looked for …")
    late = time.monotonic() + 30
    while not held:
        assert time.monotonic() < late, "the page asks for causes"
        page.wait_for_timeout(10)
    held[0].continue_()
    expect(causes).to_have_text("1 waits for 1 thing:lift {2}, which arm handles")


def test_how_old_what_is_shown_is_said(look: Look, tmp_path: Path) -> None:
    """Answers may take seconds, of a run that goes on meanwhile, though there may be no more news then."""
    tale = in_turn()
    tale.at(3.6).module("late").at(90.0).module("later")
    page = look(tale.write(tmp_path / "lifts"), "#t=3.5")
    causes = page.locator("#causes")
    expect(causes).to_have_text("1 waits for 1 thing:lift {2}, which arm handles")
    page.route("**/api/causes*", lambda _: None)
    page.keyboard.press(" ")
    expect(causes).to_have_text("1 waits for 1 thing:lift {2}, which arm handlesas of 3.500 s")


def test_an_end_that_is_far_is_told_when_the_reader_stays(look: Look, tmp_path: Path) -> None:
    """To look for it may take seconds, and a run that goes on would be elsewhere by then."""
    tale = Story().module("arm", "lift").at(1.0)
    last = first = tale.command("lift", "user")
    for _ in range(700):
        last = tale.command("lift", "user", 0, sequential_achievement(TaskId(last), THIS))
    tale.delivered(first, "arm").at(2.0).module("late")
    page = look(tale.write(tmp_path / "lifts"), f"#task={last}")
    page.set_viewport_size({"width": 2200, "height": 860})
    asked: list[str] = []
    page.route("**/api/causes*", lambda _: None)  # who counts all that wait finds the same
    page.on("request", lambda request: asked.append(request.url))
    page.keyboard.press("ArrowLeft")
    end = "in the end for lift {1}, which arm handles"
    expect(page.locator("#task .lead.end")).to_have_text(end)
    expect(page.locator(f".row[data-task='{last}'] .why .end")).to_have_text(f"; {end}")
    questions = [
        [("within" in url) for url in asked if f"/api/{what}" in url and "at=1&" in url]
        for what in ("notes", f"message/{last}")
    ]
    assert all(one[0] for one in questions)  # first what is near
    assert not all(map(all, questions))  # what one of them has found the other one may be told, too


def test_no_cause_is_left_out_until_the_news_come(look: Look, tmp_path: Path) -> None:
    """One that changes often is the one that most wait for, as a rule."""
    tale = in_turn()
    tale.queued(tale.command("sing", "user"))
    tale.at(4.0).returned(2).reached(2, *Moment).delivered(3, "arm").at(5.0)
    page = look(tale.write(tmp_path / "lifts"), "#t=3.0")
    causes = page.locator("#causes")
    text = "2 wait for 2 things:1 for sing {4}, which no module handles1 for lift {2}, which arm handles"
    expect(causes).to_have_text(text)
    page.route("**/api/causes*", lambda _: None)
    page.keyboard.press("End")
    expect(causes).to_have_text(f"{text}as of 3.000 s")


@pytest.mark.parametrize("many", [10_000, pytest.param(100_000, marks=pytest.mark.soak)])
def test_very_many_that_wait_are_told_what_for(look: Look, tmp_path: Path, many: int) -> None:
    page = look(stuck(many).write(tmp_path / "many"))
    expect(page.locator("#causes")).to_have_text(
        f"{many + 2} wait for 1 thing:calibrate {{3}}, which no module handles"
    )
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#causes")).to_contain_text("wait for 1 thing")
    page.keyboard.press("End")
    expect(page.locator(".row .why").nth(1)).to_contain_text(
        re.compile(r"calibrate \{3\} is achieved, for [\d.]+ \w+; no module handles that")
    )


def test_failures_are_found_by_what_they_say(look: Look, tmp_path: Path) -> None:
    story = Story().module("stove", "fry", "boil").at(1.0)
    fry, boil = story.command("fry", "user"), story.command("boil", "user")
    story.delivered(fry, "stove").queued(boil, "stove").at(2.0).returned(fry, Outcome.FAILED)
    story.say(facts.Failed(fry, "burnt", "flames everywhere")).reached(fry, *Moment).at(3.0)
    page = look(story.write(tmp_path / "kitchen"))
    for words, found in (
        ("burnt", 1),
        ("Flames", 1),
        ("fail", 1),
        ("failed fry burnt", 1),
        ("boil burnt", 0),
        ("queued stove", 1),
        ("stove", 2),
        ("{2}", 1),
    ):
        page.locator("#search").fill(words)
        expect(page.locator("#found")).to_have_text(f"{found} found")
    page.locator("#search").fill("burnt")
    page.locator("body").press("Home")
    page.evaluate("tca.slider.setTime(1.5)")
    expect(page.locator("#found")).to_have_text("0 found")


def test_where_a_task_counts_for_several_things_the_line_of_causes_says_so(look: Look, tmp_path: Path) -> None:
    story = Story().at(1.0)
    one, two = story.command("one", "user"), story.command("two", "user")
    story.queued(one).queued(two).at(2.0)
    head = look(story.write(tmp_path / "apart")).locator("#causes span").first
    expect(head).to_have_text("2 wait for 2 things:")
    expect(head).to_have_attribute("title", "")
    story.command("three", "user", 0, *(sequential_achievement(TaskId(first), THIS) for first in (one, two)))
    head = look(story.at(3.0).write(tmp_path / "together")).locator("#causes span").first
    expect(head).to_have_text("3 wait for 2 things:")
    expect(head).to_have_attribute("title", "a task that waits for several things counts for each")


def test_tasks_of_the_name_that_is_looked_for_come_first(look: Look, tmp_path: Path) -> None:
    story = Story().module("fry van", "deliver").at(1.0)
    day, other = story.goal("day", "user"), story.command("deliver", "user")
    story.delivered(other, "fry van").at(2.0).returned(other).reached(other, Moment.END_ACHIEVING)
    named, idle = story.command("fry", "user"), story.command("late deliver", "user")
    story.say(facts.Killed(TaskId(day), "deliver and fry failed", "user")).at(3.0)
    page = look(story.write(tmp_path / "bakery"))
    for words, order in (
        ("deliver", [other, idle, day]),
        ("fry", [named, other, day]),
        ("failed", [day]),
        ("deliver achieved", [other]),
        ("", []),
    ):
        page.locator("#search").fill(words)
        assert page.evaluate("[...tca.tree.found].map((task) => task.id)") == order
    page.locator("#search").fill("deliver")
    for number in (other, idle, day, other):
        page.keyboard.press("Enter")
        expect(page.locator("#task h2")).to_contain_text(f"{{{number}}}")


def test_delays_are_told_everywhere(look: Look, tmp_path: Path) -> None:
    page = look(delayed().write(tmp_path / "dinner"), "#task=2")
    why = page.locator(".row[data-task='2'] .why")
    expect(why).to_have_text("until 3.00 s after ring bell {1} is …, for 1.00 s; that waits until 500.250 s")
    expect(why).to_have_attribute("title", "waits until 3.00 s after ring bell {1} is achieved\n\nthat"
                                  " waits until 500.250 s")  # fmt: skip
    expect(page.locator("#task .lead").first).to_contain_text("waits until 3.00 s after ring bell {1} is achieved")
    expect(page.locator("#task table")).to_contain_text(
        ["", "start achieving not before 3.00 s after ring bell {1} end achieving"]
    )
    expect(page.locator(".row[data-task='1'] .kind")).to_have_text("SEQ + 3.00 s")


def test_bars_of_what_nobody_handles_have_names_and_are_seen_in_the_dark(look: Look, tmp_path: Path) -> None:
    page = look(stuck().write(tmp_path / "stuck"))
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(f"({_OF_NOBODY}).step") > 10
    assert page.evaluate(_BRIGHTEST) > 70


_OF_NOBODY = "tca.chart.layout.find((one) => one.row.label === '(no handler)')"
_BRIGHTEST = """(() => {
  const { canvas, layout } = tca.chart, { top } = layout.find((one) => one.row.label === '(no handler)');
  tca.chart.draw();
  const seen = canvas.getContext("2d").getImageData(canvas.width * 0.6, (top + 3) * devicePixelRatio, 1, 1).data;
  return Math.max(...seen.slice(0, 3)) * seen[3] / 255;
})()"""
"""The strongest colour of its first bar."""
