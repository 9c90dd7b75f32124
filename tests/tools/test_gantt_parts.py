"""Gantt charts of a part of a run, of locks and suspensions, as files, and of very many bars."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from tools.story import COMMAND, Story, locking, stumbling, walking

from tca_tools.gantt.blocks import in_blocks, queue_lengths, share_of
from tca_tools.gantt.build import NO_HANDLER, SUSPENDED, chart
from tca_tools.gantt.chart import Chart, Kind
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.window import ALL, Pick
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome

Tca = Callable[..., Result]
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return stumbling().write(tmp_path / "run")


def busy(steps: int, rows: int = 1) -> Story:
    """So many short steps, each in the next row."""
    story = Story()
    for number in range(rows):
        story.module(f"legs {number}", "step")
    for number in range(steps):
        command = story.at(float(number)).received("step", COMMAND, "x")
        story.delivered(command, f"legs {number % rows}").at(number + 0.01).returned(command)
    return story


def labels(drawing: Chart) -> list[str]:
    return [row.label for row in drawing.rows]


def test_locks_and_suspensions_in_blocks(tca: Tca, tmp_path: Path, expect: Callable[[str, str], None]) -> None:
    folder = locking().write(tmp_path / "locking")
    expect("gantt_locking", tca("gantt", folder, COLUMNS="100").stdout)
    expect("gantt_locking_story", tca("gantt", folder, "--story", 4, "--ascii", COLUMNS="100").stdout)


def test_a_lock_is_in_the_row_of_the_copy_that_it_was_asked_of() -> None:
    """It is for all of them, yet one row shows it, as the journal says."""
    story = Story().module("legs", "move").module("legs#2", "move").module("eyes").at(1.0)
    story.say(facts.Claimed(90, "legs#2", "legs#2", False, "eyes", TaskId(0)), facts.Granted(90))
    held = {
        row.label: len(row.claims) for row in chart(story.at(3.0).say(facts.ClaimEnded(90, "released")).fold()).rows
    }
    assert held == {"legs": 0, "legs#2": 1}


def test_the_label_of_a_long_name_has_all_of_it_at_the_mouse() -> None:
    name = "controller of the left " * 3
    drawing = svg_text(chart(Story().module(name, "move").module("legs", "step").fold()), "run")
    assert re.findall(r'class="label"[^>]*>(.*?)</text>', drawing) == [f"{name[:39]}…<title>{name}</title>", "legs"]


def test_who_has_a_resource_for_himself() -> None:
    legs = chart(locking().fold()).rows[1]
    assert [(one.start, one.end, one.kind, one.name) for one in legs.claims] == [
        (2.0, 3.0, Kind.LOCKED, "eyes"),
        (4.0, 5.0, Kind.RESERVED, "planner"),
    ]
    assert (
        legs.claims[0].title()
        == "legs locked by eyes while handling look {3} from 2.000 s to 3.000 s, 1.000 s: released"
    )
    picture = svg_text(chart(locking().fold()), "locking")
    assert "locked by eyes" in picture
    assert "reserved by planner" not in picture.replace("legs reserved by planner", "")  # a bar stands in its place


def test_suspended_tasks_have_a_row_below_the_modules_as_in_the_page() -> None:
    run = locking().fold()
    last = chart(run).rows[-1]
    assert (last.label, [(bar.name, bar.start, bar.end) for bar in last.queued]) == (SUSPENDED, [("adjust", 1.0, 3.5)])
    assert not any(bar.kind is Kind.SUSPENDED for row in chart(run).rows[:-1] for bar in row.queued)
    story = Story().module("legs", "walk")
    walk = story.goal("walk", "x")
    story.at(1.0).say(facts.SuspendedOrResumed(TaskId(walk), True, "panel")).at(2.0)
    bar = chart(story.fold()).rows[-1].queued[0]
    assert (bar.kind, bar.start, bar.end, bar.is_open) == (Kind.SUSPENDED, 1.0, 2.0, True)
    assert bar.title() == "walk {1} suspended by panel from 1.000 s on, 1.000 s"


def test_a_suspended_task_is_its_modules_who_would_have_handled_it_even_when_that_has_left() -> None:
    story = Story().module("legs", "move", resource="left").at(0.5).module("wheels", "move")
    move = story.at(1.0).command("move", "x")
    story.say(facts.SuspendedOrResumed(TaskId(move), True)).at(3.0).say(facts.SuspendedOrResumed(TaskId(move), False))
    story.at(4.0)
    for name in ("wheels", "legs"):
        story.say(facts.HandlerRemoved("move", name), facts.ModuleLeft(name, "it said goodbye"))
    late = story.command("move", "x")
    story.say(facts.SuspendedOrResumed(TaskId(late), True)).at(5.0)
    run = story.fold()

    def suspended(*modules: str) -> list[float]:
        rows = chart(run, pick=Pick(modules=modules) if modules else ALL).rows
        return [bar.start for row in rows for bar in row.queued if bar.kind is Kind.SUSPENDED]

    assert (suspended(), suspended("wheels"), suspended("legs")) == ([1.0, 4.0], [1.0], [])


def test_a_row_only_of_what_is_not_shown_is_left_out() -> None:
    story = Story().module("legs", "walk")
    story.queued(story.goal("dance", "x")).at(1.0).delivered(1, "legs").at(9.0)
    assert labels(chart(story.fold())) == ["legs", NO_HANDLER]
    assert labels(chart(story.fold(), start=2.0)) == ["legs"]


def test_a_wait_for_a_lock_is_a_wait_of_its_handler() -> None:
    look = chart(locking().fold()).rows[2].handled[0]
    assert [(wait.start, wait.end) for wait in look.waits] == [(1.0, 2.0)]
    assert look.waits[0].title() == "look {3} waits for lock of legs {90} from 1.000 s to 2.000 s, 1.000 s"


def test_only_some_modules(tca: Tca, run: Path) -> None:
    drawing = chart(walking().fold(), pick=Pick(frozenset({"controller", "perception"})))
    assert labels(drawing) == ["perception", "controller"]
    shown = tca("gantt", run, "--module", "controller").stdout
    assert "move leg" in shown
    assert "gait planner" not in shown
    assert (
        "no module 'controler' in this journal: did you mean 'controller'?"
        in tca("gantt", run, "--module", "controler").stderr
    )


def test_only_a_subtree_with_what_its_handlers_ask(tca: Tca, run: Path) -> None:
    shown = tca("gantt", run, "--task", 3).stdout
    assert [line.split("  ")[0] for line in shown.splitlines()[3:6]] == ["gait planner", "", "perception"]
    assert "controller" not in shown  # take steps {3} never got as far
    assert "controller" in tca("gantt", run, "--task", "take steps").stdout  # all tasks of that name


def test_tasks_that_are_not_there(tca: Tca, run: Path) -> None:
    for asked, told in (
        (("--task", "take step"), "no task 'take step' in this journal: did you mean 'take steps'?"),
        (("--task", 99), "no task '99' in this journal"),
        (("--task", 5), "elevation map {5} is a query, no task: 'tca tree --story 5' tells what became of it"),
        (("--story", "take steps"), "3 tasks are called 'take steps': name one by its number: 2, 3, 4"),
    ):
        result = tca("gantt", run, *asked)
        assert result.exit_code == 1
        assert told in result.stderr
    assert tca("gantt", run, "--task", 1, "--story", 1).exit_code == 2


def test_the_story_of_a_task_begins_when_it_was_sent(tmp_path: Path, tca: Tca) -> None:
    folder = locking().write(tmp_path / "locking")
    assert tca("gantt", folder, "--story", 4).stdout.startswith("locking, story of 4: 1.00 to ")
    assert tca("gantt", folder, "--story", 4, "--from", 0).stdout.startswith("locking, story of 4: 0.00 to ")


def test_the_story_of_a_task_shows_paler_what_it_waited_for(tmp_path: Path, tca: Tca) -> None:
    folder = locking().write(tmp_path / "locking")
    assert tca("gantt", folder, "--story", 4, "-o", tmp_path / "story.svg").exit_code == 0
    picture = ET.fromstring((tmp_path / "story.svg").read_text())
    titled = {
        (rectangle.findtext(f"{SVG}title") or "").split(" from ")[0]: rectangle.get("class")
        for rectangle in picture.iter(f"{SVG}rect")
    }
    assert titled["move {4} handled by legs"] is None
    assert titled["move {2} handled by legs"] == "beside"  # had the legs
    assert titled["look {3} handled by eyes"] == "beside"  # had locked them
    assert "adjust {5} handled by legs" not in titled
    written = {one.text: one.get("class", "").partition(" ")[0] for one in picture.iter(f"{SVG}text")}
    assert written["look"] == "in"  # dark: white could not be read there


def test_the_story_of_a_task_ends_with_it_though_others_go_on(tmp_path: Path, tca: Tca) -> None:
    story = Story().module("legs", "move").module("user").at(1.0)
    first, second = story.command("move", "user"), story.command("move", "user")
    story.queued(second, "legs").acted(first, "legs", 1.0).acted(second, "legs", 1.0)
    story.at(50.0).say(facts.WaitBegan("user", 0, TaskId(first), Moment.END_ACHIEVING)).at(60.0)
    story.say(facts.WaitEnded("user", 0, TaskId(first))).at(70.0)
    folder = story.write(tmp_path / "late")
    assert tca("gantt", folder, "--story", second).stdout.splitlines()[0] == "late, story of 2: 1.00 to 3.04 s"
    assert tca("gantt", folder, "--story", second, "--to", 9).stdout.startswith("late, story of 2: 1.00 to 9.00 s")
    assert tca("gantt", folder, "--story", first).stdout.startswith("late, story of 1: 1.00 to 2.02 s")
    assert tca("gantt", folder, "--story", first, "--at", 1.5).stdout.startswith("late, story of 1: 1.00 to 1.50 s")


def test_as_it_was(tca: Tca, run: Path) -> None:
    at = tca("gantt", run, "--at", 2.0, COLUMNS="100").stdout
    assert at.splitlines()[0] == "run: 0.47 to 2.00 s"
    assert "move body" not in at
    part = tca("gantt", run, "--from", 1.0, "--to", 4.0, COLUMNS="100").stdout
    assert part.splitlines()[0] == "run: 1.00 to 4.00 s"
    assert "█!" in part  # what went on at 4.0 s failed later


def test_files(tca: Tca, run: Path, tmp_path: Path) -> None:
    beginnings = {"svg": b"<svg", "txt": b"run: 0.42", "html": b"<!doctype html>", "png": b"\x89PNG", "pdf": b"%PDF"}
    for kind, beginning in beginnings.items():
        result = tca("gantt", run, "-o", tmp_path / f"chart.{kind}")
        assert result.exit_code == 0, result.stderr
        assert (tmp_path / f"chart.{kind}").read_bytes().startswith(beginning)
    assert "must end in .svg, .png, .pdf, .html or .txt" in tca("gantt", run, "-o", tmp_path / "chart.gif").stderr


def test_a_picture_that_needs_a_package_says_which(
    tca: Tca, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "vl_convert", None)
    result = tca("gantt", run, "-o", tmp_path / "chart.png")
    assert result.exit_code == 1
    assert "pip install 'tca-central[pictures]'" in result.stderr
    assert not (tmp_path / "chart.png").exists()


def test_a_page_fetches_nothing_and_stays_well_formed(tca: Tca, tmp_path: Path) -> None:
    folder = locking().write(tmp_path / "</script>")
    tca("gantt", folder, "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert not re.findall(r"(?:src|href|url)\s*[=(]\s*['\"]?\s*(?:https?:)?//", page)
    assert page.count("</script>") == 1
    for drawing in re.findall(r"<svg .*?</svg>", page, re.DOTALL):
        ET.fromstring(drawing)
    assert "z16" in page  # what shows only when it is zoomed


def test_a_long_run_is_a_picture_of_bounded_size() -> None:
    drawing = chart(busy(steps=12_000).fold())
    picture = svg_text(drawing, "long")
    assert float(ET.fromstring(picture).get("width", 0)) <= 2_000
    assert picture.count("<rect") < 1_000
    assert re.search(r"\d+ messages from [\d.]+ s to [\d.]+ s, 1% of the time: \d+ step", picture)


def test_ten_thousand_bars_of_ten_modules() -> None:
    picture = svg_text(chart(busy(steps=10_000, rows=10).fold()), "many")
    assert [text.text for text in ET.fromstring(picture).iter(f"{SVG}text")].count("legs 7") == 1
    assert picture.count("<rect") < 6_000


def test_narrow_bars_are_put_together_only_with_neighbours() -> None:
    bars = chart(busy(steps=3).fold()).rows[0].handled
    wide, blocks = in_blocks(bars, 0.0, 2.0, 0.5)
    assert ([bar.start for bar in wide], [len(block.parts) for block in blocks]) == ([2.0], [2])
    assert (round(blocks[0].start, 6), blocks[0].end, round(share_of(blocks[0]), 3)) == (0.0, 1.01, 0.02)


def test_what_failed_is_seen_in_a_block() -> None:
    story = busy(steps=1000)
    failing = story.at(1000.0).received("step", COMMAND, "x")
    story.delivered(failing, "legs 0").at(1000.01).returned(failing, Outcome.FAILED)
    picture = svg_text(chart(story.fold()), "failing")
    assert picture.count("#c81e1e") == 4  # its foot and flag, in the style of frames, and in the legend


def test_of_a_long_queue_the_length_is_shown(tca: Tca, tmp_path: Path) -> None:
    story = Story().module("legs", "step")
    ids = [story.at(number * 1.0).received("step", COMMAND, "x") for number in range(40)]
    for number in ids:
        story.queued(number, "legs")
    for number in ids:
        story.at(100.0 + number).delivered(number, "legs").returned(number)
    legs = chart(story.fold()).rows[0]
    lengths = queue_lengths(legs.queued, 0.0, 10.0)
    assert max(number for *_, number in lengths) == 40
    assert "up to 40 queued" in svg_text(chart(story.fold()), "long queue")
    assert " 40 " in tca("gantt", story.write(tmp_path / "run"), COLUMNS="100").stdout


def test_of_many_suspended_the_number_is_shown(tca: Tca, tmp_path: Path) -> None:
    """Beside their block, which is far from the beginning: nobody has to guess what is grey there."""
    story = Story().module("legs", "step")
    ids = [story.at(number * 1.0).received("step", COMMAND, "x") for number in range(10)]
    for number in ids:
        story.say(facts.SuspendedOrResumed(TaskId(number), is_suspended=True))
    for number in ids:
        story.at(100.0 + number).say(facts.SuspendedOrResumed(TaskId(number), is_suspended=False)).delivered(
            number, "legs"
        ).returned(number)
    picture = svg_text(chart(story.fold()), "many suspended")
    assert "up to 10 suspended" in picture
    assert "at most 9 suspended from " in picture
    assert "┄ 10 ┄" in tca("gantt", story.write(tmp_path / "run"), COLUMNS="100").stdout
