"""Reasons in the rows of the page. A row shows the part that fits; hover and the pane show all."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import QUERY, THIS, Story, made, stumbling

from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome
from view.conftest import OpenPage

pytestmark = pytest.mark.slow

WHOLE = "for controller of all legs, which terrain scanner has locked while handling scan the whole terrain {1}"
TRACE = "it slipped on ice\n  File 'legs.py', line 7\n    " + "deep " * 80 + "at the root"


def test_reason_is_cut_in_the_row_and_whole_on_hover(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("locked").write(tmp_path / "walk"))
    why = page.locator(".row[data-task='2'] .why")
    for width, text in {2400: f"{WHOLE}, for 3 s", 1440: WHOLE}.items():
        page.set_viewport_size({"width": width, "height": 800})
        expect(why).to_have_text(text)
        expect(why).to_have_attribute("title", WHOLE)
        assert why.evaluate("(cell) => cell.scrollWidth <= cell.clientWidth")
    why.click()
    expect(page.locator("#task .lead")).to_have_text(f"waits {WHOLE}, for 3 s")
    failed = page.locator(".row[data-task='3'] .why")
    expect(failed).to_contain_text("failed: slip: it slipped on ice")
    expect(failed).to_have_attribute("title", f"slip: {TRACE}")
    failed.click()
    expect(page.locator("#task .lead.bad")).to_contain_text("at the root")


@pytest.mark.soak
def test_narrow_row_shows_the_last_cause(open_page: OpenPage, tmp_path: Path) -> None:
    story = (
        Story().module("radiology", "ct scan", resource="scanner").module("brain", "treat").at(1.0)
    )
    first, scan = story.command("ct scan", "user"), story.command("ct scan", "user")
    story.delivered(first, "radiology", "scanner").queued(scan, "radiology", "scanner")
    treat = story.goal("treat", "user")
    story.delivered(treat, "brain")
    question = story.received("consent of the patient", QUERY, "brain", origin=treat)
    story.queued(question).say(facts.WaitBegan("brain", treat, TaskId(question), 0))
    page = open_page(story.at(70.0).write(tmp_path / "ward"))
    scanner, consent = (
        "for radiology / scanner, busy with ct scan {1}",
        "for the reply to consent of the patient {4} (no module handles it)",
    )
    for width, reason in {
        2400: [f"{scanner}, for 69 s", f"{consent}, for 69 s"],
        700: [scanner, consent],
    }.items():
        page.set_viewport_size({"width": width, "height": 800})
        for number, text in zip((scan, treat), reason, strict=True):
            expect(page.locator(f".row[data-task='{number}'] .why")).to_have_text(text)


@pytest.mark.soak
def test_past_reason_excludes_later_facts(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(stumbling().write(tmp_path / "walk"), "#t=4.2&task=7")
    expect(page.locator("#task .state")).to_have_text("handling")
    times = page.locator("#task > table").first
    expect(times).to_contain_text("handlingsince 3.400 s  (800 ms so far)")
    handled = page.locator("#story tr").last
    expect(handled).to_contain_text("handled by controller")
    expect(handled).to_contain_text("…")
    expect(page.locator("#story")).not_to_contain_text("failed")
    expect(page.locator("#chain")).to_have_count(0)
    expect(page.locator("#later")).to_contain_text("failed: terrain collision")
    page.keyboard.press("End")
    expect(times).to_contain_text("handling3.400 s – 4.500 s  (1.1 s)")
    expect(page.locator("#story")).to_contain_text("handled by controller: failed")
    expect(page.locator("#later")).to_have_count(0)
    expect(page.locator("#chain")).to_have_count(1)


@pytest.mark.soak
def test_past_reason_of_a_query_excludes_later_facts(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("eyes", "look").at(1.0)
    query = story.received("look", MessageClass.QUERY, "user")
    story.delivered(query, "eyes").at(3.0).returned(query, Outcome.FAILED, data={"seen": 0})
    story.say(facts.Failed(query, "blind", "")).say(facts.Answered(query))
    page = open_page(story.write(tmp_path / "blind"), f"#t=2&task={query}")
    expect(page.locator("#task h2")).to_have_text("look {1}")
    expect(page.locator("#task .lead")).to_have_count(0)
    expect(page.locator("#task pre")).to_have_count(0)
    page.keyboard.press("End")
    expect(page.locator("#task .lead").first).to_have_text("blind")
    expect(page.locator("#task pre")).to_contain_text("seen")


@pytest.mark.soak
def test_holding_constraints_come_before_met_ones(open_page: OpenPage, tmp_path: Path) -> None:
    """A clean waits for twenty moves. All moves are achieved except the second and the last."""
    story = Story().module("legs", "move").at(1.0)
    moves = [story.command("move", "user") for _ in range(20)]
    clean = story.command(
        "clean", "user", 0, *(sequential_achievement(TaskId(one), THIS) for one in moves)
    )
    for move in {*moves} - {2, 20}:
        story.at(1.0 + move).delivered(move, "legs").returned(move).reached(
            move, Moment.END_ACHIEVING
        )
    page = open_page(story.at(30.0).write(tmp_path / "walk"), f"#t=29&task={clean}")
    rows = page.locator("#constraints tr")
    first = [f"•start achieving not before move {{{one}}} end achieving" for one in (2, 20)]
    few = [f"✓start achieving not before move {{{one}}} end achieving" for one in (1, 3, 4)]
    expect(rows).to_have_text([*first, *few, "and 15 more met"])
    rows.last.locator("button").click()
    expect(rows).to_have_count(20)
    page.keyboard.press("End")  # the list stays unfolded
    expect(page.locator("#story .age")).not_to_have_count(0)
    expect(rows).to_have_count(20)
    page.evaluate("location.hash = 't=1.5&task=21'")
    expect(rows.last).to_have_text("and 8 more not met")


@pytest.mark.soak
def test_inherited_constraint_stands_among_the_own(open_page: OpenPage, tmp_path: Path) -> None:
    """The soup of the second meal waits for the first meal. The bread of the second meal waits for
    the soup, too.
    """
    story = Story().module("cook", "meal", "soup").at(1.0)
    first = story.goal("meal", "user")
    second = story.goal("meal", "user", 0, sequential_achievement(TaskId(first), THIS))
    course = story.delivered(second, "cook").goal("course", "cook", second)
    soup = story.delivered(course, "cook").command("soup", "cook", course)
    bread = story.command("bread", "cook", course, sequential_achievement(TaskId(soup), THIS))
    story.returned(course).returned(second).at(2.0).queued(first)
    page = open_page(story.at(3.0).write(tmp_path / "meals"), f"#task={bread}")
    rows = page.locator("#constraints tr")
    above = "•start achieving not before meal {1} end achieving, by way of meal {2}"
    expect(rows).to_have_text([f"•start achieving not before soup {{{soup}}} end achieving", above])
    page.evaluate(f"location.hash = '#task={soup}'")
    expect(rows).to_have_text([above])
    rows.locator("button").last.click()
    expect(page.locator("#task h2")).to_have_text("meal {2}")
    expect(rows).to_have_text(["•start achieving not before meal {1} end achieving"])
    page.evaluate(f"location.hash = '#task={first}'")
    expect(page.locator("#task h2")).to_have_text("meal {1}")
    expect(rows).to_have_count(0)


@pytest.mark.soak
@pytest.mark.parametrize("letters", ["A", pytest.param("deep ", marks=pytest.mark.soak)])
def test_long_text_is_shortened_and_whole_on_request(
    open_page: OpenPage, tmp_path: Path, letters: str
) -> None:
    long = letters * (100_000 // len(letters))
    story = Story().module("legs", "move").at(1.0)
    move = story.command("move", "user", data={"to": long})
    story.delivered(move, "legs").at(2.0).returned(move, Outcome.FAILED).say(
        facts.Failed(move, "slip", long)
    )
    page = open_page(story.reached(move, *Moment).write(tmp_path / "long"), f"#task={move}")
    expect(page.locator("#task .lead.bad")).to_contain_text("show all 100006 characters")
    assert page.evaluate("document.getElementById('task').textContent.length") < 30_000
    assert page.evaluate("document.querySelector('.row .why').textContent.length") < 1000
    page.locator("#task .lead.bad button").click()
    expect(page.locator("#task textarea")).to_have_value(f"slip: {long}")
    page.locator("#tab-messages").click()
    expect(page.locator("#messages .line").last).to_be_attached()
    assert page.evaluate("document.getElementById('messages').textContent.length") < 10_000


@pytest.mark.soak
def test_traceback_retains_its_lines_without_carets(open_page: OpenPage, tmp_path: Path) -> None:
    text = "ZeroDivisionError\n  File 'legs.py', line 7\n    return 1/0\n           ~^~\nZeroDivisionError: division"
    story = Story().module("legs", "move").at(1.0)
    move = story.command("move", "user")
    story.delivered(move, "legs").at(2.0).returned(move, Outcome.FAILED).say(
        facts.Failed(move, "handler error", text)
    )
    page = open_page(story.write(tmp_path / "trace"), f"#task={move}")
    told = page.locator("#story .said", has_text="File")
    expect(told).to_have_text(
        "failed: handler error: ZeroDivisionError\n  File 'legs.py', line 7\n    return 1/0\nZeroDiv"
        "isionError: division",
        use_inner_text=True,
    )


@pytest.mark.soak
def test_module_that_finished_has_not_failed(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "move").module("eyes", "look").at(1.0)
    story.say(facts.ModuleLeft("legs", "it said goodbye")).at(2.0).say(
        facts.ModuleLeft("eyes", "its connection closed", lost=True)
    )
    page = open_page(story.write(tmp_path / "gone"))
    page.locator("#tab-messages").click()
    expect(page.locator("#messages .line", has_text="its connection closed")).to_have_class(
        re.compile("bad")
    )
    expect(page.locator("#messages .line", has_text="goodbye")).not_to_have_class(re.compile("bad"))
