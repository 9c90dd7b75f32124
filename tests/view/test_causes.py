"""The final causes of waits: on every row, in the pane, and for all tasks in the header."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import THIS, Story, made, stuck

from tca_wire.constraints import sequential_achievement
from tca_wire.points import TaskId
from view.conftest import OpenPage

pytestmark = pytest.mark.slow

END = "in the end for calibrate {3}, which no module handles"


def test_waiting_rows_and_header_name_the_final_cause(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(stuck().write(tmp_path / "stuck"), "#task=6")
    page.set_viewport_size({"width": 2200, "height": 860})
    why = {number: page.locator(f".row[data-task='{number}'] .why") for number in range(1, 7)}
    expect(why[1]).to_have_text(
        f"until drill {{2}}, drill {{4}}, drill {{5}} and 1 more are achieved, for 3 s; {END}"
    )
    expect(why[2]).to_have_text(f"until calibrate {{3}} is achieved, for 3 s; {END}")
    expect(why[3]).to_have_text("for a module that handles calibrate, for 3 s")
    expect(why[6]).to_have_text(f"until drill {{5}} is achieved, for 3 s; {END}")
    expect(page.locator("#task .lead.end")).to_have_text(END)
    page.set_viewport_size({"width": 1300, "height": 860})
    expect(why[6]).to_have_text(f"until drill {{5}} is achieved; {END}")
    page.locator("#task .lead.end button").click()
    expect(page.locator("#task h2")).to_have_text("calibrate {3}")
    why[1].click()
    expect(page.locator("#task h2")).to_have_text("mission {1}")
    causes = page.locator("#causes")
    expect(causes).to_have_text("6 wait for 1 thing:calibrate {3}, which no module handles")
    page.keyboard.press("Home")
    expect(causes).to_have_text("nothing waits")
    page.keyboard.press("End")
    causes.locator("button").click()
    expect(page.locator("#task h2")).to_have_text("calibrate {3}")


@pytest.mark.soak
def test_ended_task_is_not_named_as_a_cause(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("in_turn").write(tmp_path / "lifts"), "#t=1.5")
    page.set_viewport_size({"width": 2200, "height": 860})
    second, third = (page.locator(f".row[data-task='{number}'] .why") for number in (2, 3))
    causes = page.locator("#causes")
    expect(second).to_contain_text("until lift {1} is achieved")
    expect(third).to_contain_text(
        "until lift {2} is achieved, for 500 ms; in the end for lift {1}, which arm handles"
    )
    expect(causes).to_have_text("2 wait for 1 thing:lift {1}, which arm handles")
    page.route("**/api/notes*", lambda _: None)  # no answer for a while
    page.keyboard.press("End")
    expect(page.locator(".row[data-task='1']")).to_have_class(re.compile("achieved"))
    assert "lift {1}" not in second.inner_text()
    expect(third).to_have_text("until lift {2} is achieved, for 2 s")
    expect(causes).to_have_text("1 waits for 1 thing:lift {2}, which arm handles")


@pytest.mark.soak
def test_new_wait_has_no_duration(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("in_turn").write(tmp_path / "lifts"), "#t=1.0&task=3")
    page.set_viewport_size({"width": 2200, "height": 860})
    why, lead = page.locator(".row[data-task='3'] .why"), page.locator("#task .lead").first
    end = "in the end for lift {1}, which arm handles"
    expect(why).to_have_text(f"until lift {{2}} is achieved; {end}")
    expect(lead).to_have_text("waits until lift {2} is achieved")
    page.keyboard.press("End")
    expect(why).to_have_text("until lift {2} is achieved, for 2 s")
    expect(lead).to_have_text("waits until lift {2} is achieved, for 2 s")


def waiting_chain(number: int) -> Story:
    """Return a chain of waiting tasks. The first one is handled."""
    story = Story().module("arm", "lift").at(1.0)
    last = first = story.command("lift", "user")
    for _ in range(number):
        last = story.command("lift", "user", 0, sequential_achievement(TaskId(last), THIS))
    return story.delivered(first, "arm").at(2.0).module("late")


@pytest.mark.soak
@pytest.mark.parametrize("many", [3_000, pytest.param(20_000, marks=pytest.mark.soak)])
def test_very_long_chain_of_waits_names_its_causes(
    open_page: OpenPage, tmp_path: Path, many: int
) -> None:
    page = open_page(waiting_chain(many).write(tmp_path / "many"), f"#task={many + 1}")
    for key in ("End", "ArrowLeft", "End"):
        page.keyboard.press(key)
        expect(page.locator("#causes")).to_have_text(
            f"{many:,} wait for 1 thing:lift {{1}}, which arm handles"
        )
    expect(page.locator("#task .lead.end")).to_have_text(
        "in the end for lift {1}, which arm handles"
    )
    assert page.evaluate(ASKED) == many


ASKED = (
    "() => fetch('api/causes?at=1').then((answer) => answer.json()).then(({ waiting }) => waiting)"
)


@pytest.mark.soak
def test_cause_line_says_when_a_task_counts_more_than_once(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().at(1.0)
    one, two = story.command("one", "user"), story.command("two", "user")
    story.queued(one).queued(two).at(2.0)
    story.command(
        "three", "user", 0, *(sequential_achievement(TaskId(first), THIS) for first in (one, two))
    )
    head = open_page(story.at(3.0).write(tmp_path / "together")).locator("#causes span").first
    expect(head).to_have_text("3 wait for 2 things:")
    expect(head).to_have_attribute("title", "a task that waits for several things counts for each")


def test_delay_is_shown_in_every_view(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("delayed").write(tmp_path / "dinner"), "#task=2")
    why = page.locator(".row[data-task='2'] .why")
    expect(why).to_contain_text("until 3 s after ring bell {1} is achieved")
    expect(why).to_contain_text("until 500.250 s")
    expect(page.locator("#task .lead").first).to_contain_text(
        "waits until 3 s after ring bell {1} is achieved"
    )
    expect(page.locator("#task table")).to_contain_text(
        ["", "start achieving not before 3 s after ring bell {1} end achieving"]
    )
    expect(page.locator(".row[data-task='1'] .kind")).to_have_text("SEQ + 3 s")
