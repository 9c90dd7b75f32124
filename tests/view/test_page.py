"""The page in a real browser, used by mouse and keyboard."""

import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from processes import central
from tools.story import Story, stumbling, walking

from tca_module import Command, Goal, Module, Task, connect
from tca_tools.journal.journals import EntryPlace, Log
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.journal.records import record
from tca_wire.points import Moment, TaskId
from view.conftest import OpenPage, served, until

pytestmark = pytest.mark.slow


def line(page: Page, task: int) -> Locator:
    return page.locator(f".row[data-task='{task}']")


def test_reason_of_a_wait_shows_without_a_click(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(walking().write(tmp_path / "walk"))
    expect(line(page, 9)).to_contain_text(
        "until its parent take steps {3} is being achieved; in the end for move body {7}"
    )
    expect(line(page, 4)).to_contain_text(
        "until take steps {3} is being achieved; in the end for move body {7}"
    )
    expect(page.locator("#counts")).to_contain_text("1 handling")
    expect(page.locator("#status")).to_have_text("not closed")  # no writer, and no closing entry
    line(page, 4).click()
    expect(page.locator(".row .kind")).to_have_text("SEQ, plan ahead")
    for width in (1400, 800, 420):
        page.set_viewport_size({"width": width, "height": 800})
        cut = "(row) => { const name = row.querySelector('.name'); return name.scrollWidth > name.clientWidth; }"
        assert not any(row.evaluate(cut) for row in page.locator(".row").all())
        boxes = "(row) => ['.name', '.kind'].map((part) => row.querySelector(part).getBoundingClientRect().toJSON())"
        name, kind = line(page, 3).evaluate(boxes)
        assert name["x"] + name["width"] <= kind["x"]  # no overlap
    assert page.locator("#slider").bounding_box()["width"] > 300  # type: ignore[index]


def test_failed_run_can_be_explored(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(stumbling().write(tmp_path / "walk"))
    expect(page.locator("#status")).to_have_text("ended")
    expect(line(page, 7)).to_contain_text("failed: terrain collision: leg 4 met")
    expect(line(page, 1)).to_contain_text(
        "killed: failure 'terrain collision' of move body {7} was not handled"
    )
    page.locator("#counts button[data-state='failed']").click()
    expect(page.locator("#task h2")).to_have_text("move body {7}")
    expect(page.locator("#task")).to_contain_text("handled by controller: failed")
    expect(page.locator("#task")).to_contain_text("held, until move leg {6} is achieved")
    page.locator(".row[data-task='2'] .twist").click()
    expect(line(page, 6)).to_have_count(0)
    expect(line(page, 2)).to_contain_text("+ 2")
    page.locator(".row[data-task='2'] .twist").click()
    expect(line(page, 6)).to_have_count(1)
    x, y = page.evaluate("""() => {
      const { chart } = tca, place = chart.layout.find((one) => one.row.label === "controller");
      const span = place.row.handled.lists[0].find((one) => one.name === "move leg"), box = chart.canvas.getBoundingClientRect();
      const [from, to] = chart.window, middle = (span.start + span.end) / 2;
      const x = chart.labelWidth + (middle - from) / (to - from) * (chart.width - chart.labelWidth);
      return [box.left + x, box.top + place.top + 6];
    }""")
    page.mouse.move(x, y)
    expect(page.locator("#hint")).to_contain_text(
        "move leg {6} handled by controller: 1.400 s – 3.400 s (2 s)"
    )
    page.mouse.click(x, y)
    expect(page.locator("#task h2")).to_have_text("move leg {6}")
    page.locator("#tree").focus()
    page.keyboard.press("/")
    page.keyboard.type("move controller")
    expect(page.locator("#found")).to_have_text("2 found")
    page.keyboard.press("Enter")
    expect(page.locator("#task h2")).to_have_text("move leg {6}")
    page.locator("#search").fill("killed steps")
    expect(page.locator("#found")).to_have_text("3 found")
    page.locator("#search").fill("nothing of the kind")
    expect(page.locator("#found")).to_have_text("0 found")


@pytest.mark.soak
def test_page_names_other_runs_in_the_folder(open_page: OpenPage, tmp_path: Path) -> None:
    folder = stumbling().write(tmp_path / "walk", segments=3)
    (folder / "00000002.tcaj").unlink()
    other = Entry(0, 0.0, [facts.Opened(facts.JOURNAL_VERSION, "earlier", 1, 1.0, "0.1.0")])
    (folder / "00000000.tcaj").write_bytes(record(other))
    page = open_page(folder)
    expect(page.locator("#problem")).to_contain_text("contains 2 runs")
    expect(page.locator("#problem")).to_contain_text("segment 2 is missing")
    expect(page.locator("#status")).to_have_text("ended")


def test_past_is_shown_step_by_step_and_played(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(stumbling().write(tmp_path / "walk"), "#t=1.4&task=7")
    expect(page.locator("#clock")).to_have_text("1.400 s")
    expect(line(page, 7)).to_contain_text("until move leg {6} is achieved")
    expect(page.locator("#task .state")).to_have_text("held")
    page.locator("#on").click()
    expect(page.locator("#clock")).to_have_text("1.500 s")
    page.keyboard.press("Escape")
    page.locator("#tree").focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#clock")).to_have_text("1.220 s")
    expect(line(page, 7)).to_have_count(0)
    page.keyboard.press("]")
    expect(page.locator("#clock")).to_have_text("4.500 s")
    expect(page.locator("#task h2")).to_have_text("move body {7}")
    page.keyboard.press("Home")
    expect(page.locator("#rows")).to_contain_text("no task was sent yet")
    page.keyboard.press("End")
    expect(page.locator("#clock")).to_have_text("5.000 s")
    page.evaluate("tca.slider.setTime(3.4)")
    page.locator("#tab-messages").click()
    expect(page.locator("#messages .now").first).to_contain_text("move leg {6}")
    later = page.locator("#messages .later").filter(has_text="terrain collision").first
    expect(later).to_be_visible()
    later.click()
    expect(page.locator("#task h2")).to_have_text("move body {7}")
    page.keyboard.press("Escape")
    assert_dragged_and_played(page)


def assert_dragged_and_played(page: Page) -> None:
    box = page.locator("#slider").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator("#clock")).to_have_text(re.compile(r"2\.[3-6]\d\d s"))
    page.keyboard.press("End")
    page.locator("#play").click()
    expect(page.locator("#clock")).to_have_text(
        re.compile(r"0\.\d\d\d s")
    )  # played from the beginning
    page.locator("#tab-messages").click()
    page.keyboard.press("Space")
    expect(page.locator("#play")).to_have_text("▶")
    page.locator("#speed").select_option("100")
    page.locator("#play").click()
    expect(page.locator("#clock")).to_have_text("5.000 s")
    expect(page.locator("#play")).to_have_text("▶")


@pytest.mark.soak
def test_chart_spans_first_to_last_message_with_idle_modules(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().module("legs", "move").module("lamp", "shine").at(100.0)
    story.acted(story.command("move", "user"), "legs", 10.0).at(160.0).say(
        facts.ModuleLeft("lamp", "gone")
    )
    page = open_page(story.at(300.0).say(facts.Closed("done")).write(tmp_path / "late"))
    expect(page.locator("#status")).to_have_text("ended")
    until(page, "tca.chart.window[1] < 111")
    assert page.evaluate("tca.chart.layout.map((place) => place.row.label)") == ["legs", "lamp"]
    start, end = page.evaluate("tca.chart.window")
    assert 99 < start < 100
    assert 110 < end < 111
    page.locator("#tree").focus()
    page.keyboard.press("f")
    assert page.evaluate("tca.chart.window[0]") < 0
    assert page.evaluate("tca.chart.window[1]") > 300
    page.keyboard.press("f")
    assert page.evaluate("tca.chart.window") == [start, end]
    page.evaluate("tca.slider.setTime(160)")
    until(page, "tca.chart.window[1] > 300")


@pytest.mark.soak
def test_run_name_is_whole_beside_many_states(open_page: OpenPage, tmp_path: Path) -> None:
    story = stumbling()
    story.queued(story.command("rest", "user")).command("wait", "user")
    page = open_page(story.write(tmp_path / "walk over the hills of mars"))
    name = page.locator("#name")
    for width in (1400, 1000, 910, 800, 420):
        page.set_viewport_size({"width": width, "height": 800})
        assert name.evaluate("(name) => name.scrollWidth <= name.clientWidth"), width
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), width


def test_text_from_users_is_escaped(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("<b>legs</b>")
    evil = "<img src=x onerror=alert(1)>"
    walk = story.goal(evil, "<i>user</i>", data={evil: "</script>"})
    story.delivered(walk, "<b>legs</b>").at(1.0).say(
        facts.Failed(walk, evil, "\u202e\x00" + evil + "\nsecond")
    )
    story.at(2.0).say(facts.Killed(TaskId(walk), "\x1b[2J\u202e" + evil))
    page = open_page(story.write(tmp_path / "walk"), f"#task={walk}")
    expect(page.locator("#task h2")).to_have_text(f"{evil} {{1}}")
    assert page.locator("img, script:not([src]), #task b, #task i").count() == 0
    pane = page.locator("#task")
    expect(pane.locator(".lead").first).to_have_text(f"{evil}: \\u202e\\x00{evil} second")
    expect(pane).to_contain_text(f"killed: \\x1b[2J\\u202e{evil}")
    assert not re.search("[\x00\x1b\u202e]", pane.evaluate("(pane) => pane.textContent"))


def test_truncated_journal_is_shown_with_a_warning(open_page: OpenPage, tmp_path: Path) -> None:
    data = stumbling().encoded()
    place = data.index(b"terrain collision")
    damaged = tmp_path / "damaged.tcaj"
    damaged.write_bytes(data[:place] + b"X" + data[place + 1 :])
    page = open_page(damaged)
    expect(page.locator("#problem")).to_contain_text("a damaged entry is left out")
    expect(line(page, 6)).to_contain_text("achieved")
    with damaged.open("ab") as log:
        log.write(b"X" * 50)
    expect(page.locator("#problem")).to_contain_text("no record starts here")
    expect(page.locator("#status")).to_have_text("damaged")


WALK, MOVE = Goal("walk", int), Command("move", int)


def test_page_follows_a_live_central(open_page: OpenPage, tmp_path: Path) -> None:
    with central(tmp_path, "--quiet") as daemon, connect("user", daemon.address) as user:
        legs, feet = Module("legs", daemon.address), Module("feet", daemon.address)

        @legs.handles(WALK)
        def walk(task: Task, steps: int) -> None:
            for number in range(steps):
                task.command(MOVE, number)

        @feet.handles(MOVE)
        def move(_task: Task, _number: int) -> None: ...

        user.goal(WALK, 2)
        page = open_page(daemon.journal)
        expect(page.locator("#status")).to_have_text("live")
        expect(page.locator(".row").first).to_contain_text("for a module that handles walk")
        page.locator("#tab-traffic").click()
        expect(page.locator("#traffic .pair td:first-child")).to_have_text(
            ["user → not handled yet"]
        )
        with legs.running():
            expect(page.locator(".row")).to_have_count(3)
            expect(page.locator(".row").nth(1)).to_contain_text("for a module that handles move")
            with feet.running():
                expect(page.locator("#counts")).to_have_text("3 achieved")
                expect(page.locator("#follow")).to_have_class("on")
                expect(page.locator("#traffic .pair td:first-child")).to_have_text(
                    ["user → legs", "legs → feet"]
                )


def many_tasks(number: int) -> bytes:
    """Return a robot that repeats steps of nine moves."""
    story = Story().module("planner", "step").module("legs", "move")
    for step in range(number // 10):
        story.at(step * 1.0)
        parent = story.goal("step", "user")
        story.delivered(parent, "planner").reached(parent, Moment.START_ACHIEVING)
        moves = [story.command("move", "planner", parent) for _ in range(9)]
        story.returned(parent)
        for place, move in enumerate(moves):
            story.at(step + 0.1 * place).delivered(move, "legs").at(
                step + 0.1 * place + 0.09
            ).returned(move)
            story.reached(move, Moment.END_ACHIEVING)
        if step == number // 20:
            story.say(facts.Failed(moves[4], "slip", "on ice"))
        else:
            story.reached(parent, Moment.END_PLANNING, Moment.END_ACHIEVING)
    return story.encoded()


class Halting(Log):
    """A journal that stops after its first entries until it is released, as on a slow disk."""

    def __init__(self, path: Path, first: int) -> None:
        super().__init__(path)
        self._first = first
        self.go_on = threading.Event()

    def follow_places(
        self, wait: Callable[[], object] = lambda: None
    ) -> Iterator[tuple[Entry, EntryPlace]]:
        for number, found in enumerate(super().follow_places(wait)):
            if number == self._first:
                self.go_on.wait()
            yield found


@pytest.mark.soak
def test_address_is_retained_until_its_target_is_read(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "long.tcaj"
    path.write_bytes(many_tasks(5_000))
    log, wanted = Halting(path, first=5_000), "#t=400.5&task=4000"
    with served(log) as address, browser.new_page() as page:
        try:
            page.goto(address + wanted)
            expect(page.locator("#status")).to_contain_text("reading, 4000 entries")
            expect(page.locator("#counts")).to_contain_text("achieved")  # drawn already
            assert page.evaluate("location.hash") == wanted
        finally:
            log.go_on.set()
        expect(page.locator("#clock")).to_have_text("400.500 s")
        expect(page.locator("#task h2")).to_have_text("move {4000}")
        assert page.evaluate("location.hash") == wanted


@pytest.mark.soak
@pytest.mark.parametrize("many", [5_000, pytest.param(100_000, marks=pytest.mark.soak)])
def test_page_stays_usable_with_very_many_tasks(
    open_page: OpenPage, tmp_path: Path, many: int
) -> None:
    log = tmp_path / "long.tcaj"
    log.write_bytes(many_tasks(many))
    page = open_page(log)
    expect(page.locator("#counts")).to_contain_text(f"{many - 2} achieved")
    assert page.locator(".row").count() < 100  # only visible rows
    page.locator("#counts button[data-state='failed']").click()
    expect(page.locator(".row.chosen")).to_contain_text("failed: slip: on ice")
    expect(page.locator("#task")).to_contain_text("handled by legs")
    page.locator("#search").fill("move 4444")
    page.keyboard.press("Enter")
    expect(page.locator("#found")).to_have_text("1 of 1")
    expect(page.locator(".row.chosen")).to_contain_text("4444")
    page.keyboard.press("Escape")
    page.locator("#tree").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#counts")).to_contain_text("achieved")
