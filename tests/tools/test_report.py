"""The report: a page about a run for readers new to the robot."""

import re
import sys
from collections.abc import Callable
from functools import partial
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st
from tools.story import Story, made, silent_for, stepping, stumbling, walking
from tools.test_history import FACTS

from tca_tools.errors import ToolError
from tca_tools.journal.fates import HANDLED
from tca_tools.journal.fold import History
from tca_tools.report.__main__ import report
from tca_tools.report.contents import contents
from tca_tools.report.page import page
from tca_tools.report.pictures import gantt, strips
from tca_tools.report.tree import tree
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Dropping

VOID = {"meta", "link", "br", "img", "path", "rect", "line", "hr"}
BLOCKS = {"p", "div", "tr", "li", "h1", "h2", "h3", "summary", "nav", "footer"}
HOSTILE = "<script>alert('x')</script>\"'&{{7*7}}\x1b[31m\x00\u202e"


class Page(HTMLParser):
    """A parser that checks that elements are properly nested, and collects texts, tags and
    attributes.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.blocks = [""]
        self.attributes: list[tuple[str, str | None]] = []
        self.deepest = 0
        self.feed(text)
        assert not self.stack, self.stack

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.stack.append(tag)
            self.deepest = max(self.deepest, len(self.stack))
        if tag in BLOCKS:
            self.blocks.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)
        if not {"style", "svg"} & set(self.stack):
            self.blocks[-1] += f"{data} "

    @property
    def approved(self) -> str:
        """Return the text of the page, with one line for each paragraph, row or heading."""
        return (
            "\n".join(line for block in self.blocks if (line := re.sub(r"\s+", " ", block).strip()))
            + "\n"
        )

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.texts))


Reported = Callable[[Story], Page]


@pytest.fixture
def reported(tmp_path: Path) -> Reported:
    """Return a function that makes the report of a story."""

    def run(story: Story) -> Page:
        out = tmp_path / "run.html"
        result = tca_report(story.write(tmp_path / "run"), "-o", out)
        assert result.exit_code == 0, result.output
        return Page(out.read_text())

    return run


def tca_report(*arguments: object) -> Result:
    return CliRunner().invoke(report, [str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("name", "made", "verdict"),
    [
        ("stepping", stepping, "good"),
        ("stumbling", stumbling, "bad"),
        ("recovering", partial(made, "recovering"), "bad"),
    ],
)
def test_report_matches_its_transcript(
    name: str,
    made: Callable[[], Story],
    verdict: str,
    reported: Reported,
    expect: Callable[[str, str], None],
) -> None:
    shown = reported(made())
    assert ("class", f"r-verdict {verdict}") in shown.attributes
    expect(f"report_{name}", shown.approved)


def test_report_marks_an_open_run(reported: Reported) -> None:
    shown = reported(walking())
    assert ("class", "r-verdict open") in shown.attributes
    assert "The top-level task was not over when the journal ended." in shown.text


def test_report_lists_dropped_messages_as_problems(reported: Reported) -> None:
    story = stepping()
    for number, name in enumerate(("pose", "level", "heat", "view", "sound"), 1):
        for _ in range(60 // number):
            story.say(facts.Dropped(900 + number, name, "10 wait", dropping=Dropping.OVERLOAD))
    shown = reported(story)
    assert "60 of pose dropped: its handler was too slow, left or died" in shown.text
    assert "30 of level dropped" in shown.text
    assert "2 more messages had drops: tca stats" in shown.text
    assert "None: no failure was raised" not in shown.text


def test_report_of_a_quiet_live_run_lasts_until_now(tmp_path: Path) -> None:
    out, run = tmp_path / "run.html", walking().write(tmp_path / "run")
    with silent_for(run, 60.0):
        assert tca_report(run, "-o", out).exit_code == 0
    shown = Page(out.read_text())
    assert re.search(
        r"; it is still running : this is its state at 20\S+ \S+ UTC \(64\.\d+ s\)", shown.text
    )
    assert "The top-level task is still running, as of 64." in shown.text
    assert re.search(r"6\d\.\d s from the first task to now", shown.text)
    assert "journal did" not in shown.text


def test_report_shows_one_line_of_a_traceback_until_opened(
    reported: Reported,
) -> None:
    traceback = (
        "KeyError: 'salt'\nTraceback (most recent call last):\n  File \"kitchen.py\", line 38, in fry\n"
        "    {}['salt']\n    ~~^^^^^^^^\nKeyError: 'salt'"
    )
    story = Story().module("user").module("stove", "fry")
    for _ in range(2):
        fry = story.at(1.0).command("fry", "user", to="stove")
        story.at(2.0).failed(fry, "handler error", traceback).say(
            facts.Unhandled(TaskId(fry)),
            facts.Killed(
                TaskId(fry), "failure 'handler error' of fry {1} was not handled", "central"
            ),
        )
        story.reached(fry, Moment.END_HANDLING, Moment.END_ACHIEVING)
    shown = reported(story)
    assert "\\n" not in shown.text
    assert (
        "was not achieved: first fry {1} failed: handler error: KeyError: 'salt' ...."
        in shown.text.replace("were", "was")
    )
    assert shown.text.count("~~^^^^^^^^") == 1  # the same for both, shown once
    whole = "\n".join(traceback.splitlines())
    assert whole in "".join(shown.texts)


def test_report_explains_suspension_and_missing_handlers(reported: Reported) -> None:
    shown = reported(made("mopping"))
    assert "fly : no handler" in shown.text  # in the table of times
    for words in (
        "No module handles 'fly'",
        "'mop floor' is suspended for a while",
        "Suspended tasks",
    ):
        assert words in shown.text
    assert "1 wait, 6 s" in shown.text
    assert "No advice would save" not in shown.text


def test_report_fetches_nothing_and_runs_no_script(reported: Reported) -> None:
    shown = reported(stumbling())
    assert not {"script", "link", "img", "iframe", "object", "embed", "form", "base"} & set(
        shown.tags
    )
    assert all(
        value and value.startswith("#")
        for name, value in shown.attributes
        if name in ("href", "src")
    )
    assert not [name for name, _ in shown.attributes if name.startswith("on")]
    policy = next(
        value
        for name, value in shown.attributes
        if name == "content" and value and "default-src" in value
    )
    assert policy.startswith("default-src 'none'")


def test_report_escapes_hostile_names_and_texts(reported: Reported, tmp_path: Path) -> None:
    story = Story().module(HOSTILE).module("legs" + HOSTILE, "move" + HOSTILE)
    move = story.at(1.0).command("move" + HOSTILE, HOSTILE)
    story.queued(move, "legs" + HOSTILE).at(2.0).delivered(move, "legs" + HOSTILE)
    story.at(3.0).say(
        facts.Failed(move, HOSTILE, HOSTILE + "\n" + HOSTILE * 20),
        facts.Killed(TaskId(move), HOSTILE),
    )
    story.reached(move, *Moment)
    shown = reported(story)
    raw = (tmp_path / "run.html").read_text()
    assert "<script" not in raw
    assert not re.search("[\x00\x1b\u202e]", raw)
    assert "{{7*7}}" in shown.text
    assert "\\x1b[31m\\x00\\u202e" in shown.text


def test_report_of_an_empty_run_says_so(reported: Reported) -> None:
    shown = reported(Story().at(5.0))
    for words in (
        "No task was sent.",
        "No handler ran.",
        "No failure was raised.",
        "Nothing waited.",
    ):
        assert words in shown.text


def many(tops: int, below: int, bad: int) -> History:
    """Return a run of *tops* walks of *below* moves each. A move of walk *bad* failed."""
    story = Story().module("legs", "move")
    for number in range(tops):
        walk = story.at(float(number)).goal("walk", "user")
        moves = [story.command("move", "planner", walk) for _ in range(below)]
        if number == bad:
            story.say(facts.Failed(moves[0], "slip", ""))
        for task in (*moves, walk):
            story.reached(task, *Moment)
    return story.fold()


def test_report_tree_shows_failures_and_counts_the_rest() -> None:
    found = tree(many(tops=300, below=9, bad=250), shown_at_most=100)
    assert found.shown <= 100
    rows = [row for some in found.below.values() for row in some]
    tasks = [row.task for row in rows if row.task]
    states = [task.standing for task in tasks]
    assert states.count(HANDLED) == 1  # its walk was achieved
    failed = next(task for task in tasks if task.standing == HANDLED)
    assert {task.id for task in tasks} & found.opened == {failed.id, failed.parent}
    assert sum(row.folded for row in rows) + len(states) == len(found.at.tasks) == 3000


def test_report_limits_the_nesting_of_a_deep_tree(reported: Reported) -> None:
    story = Story()
    parent = 0
    for _ in range(600):
        parent = story.goal("dig", "x", parent)
    shown = reported(story)
    assert shown.deepest < 120
    assert "[depth " in shown.text


def test_report_of_a_long_run_has_bounded_size(tmp_path: Path) -> None:
    story = Story().module("legs", "move")
    for number in range(3_000):
        move = story.at(float(number)).command("move", "user")
        story.delivered(move, "legs").at(number + 0.5).achieved(move)
    assert tca_report(story.write(tmp_path / "run"), "-o", tmp_path / "run.html").exit_code == 0
    shown = Page((tmp_path / "run.html").read_text())
    assert len((tmp_path / "run.html").read_bytes()) < 1_000_000
    assert "The run is too long for one chart." in shown.text
    assert " of 3,000 tasks" in shown.text


def test_report_of_a_cut_journal_shows_the_readable_part(tmp_path: Path) -> None:
    whole = stumbling().encoded()
    (tmp_path / "run.tcaj").write_bytes(whole[: len(whole) * 2 // 3])
    result = tca_report(tmp_path / "run.tcaj", "-o", tmp_path / "run.html")
    assert result.exit_code == 0 or "the entries before it are shown" in result.output
    (tmp_path / "bad.tcaj").write_bytes(whole[: len(whole) // 2] + b"\xff" * 500)
    result = tca_report(tmp_path / "bad.tcaj", "-o", tmp_path / "bad.html")
    assert result.exit_code == 1
    assert "the entries before it are shown" in result.output
    shown = Page((tmp_path / "bad.html").read_text())
    assert "A part of the journal can't be read: " in shown.text
    assert "traverse arc {1}" in shown.text


def test_report_explains_wrong_paths(tmp_path: Path) -> None:
    run = stepping().write(tmp_path / "run")
    assert "must end in .html" in tca_report(run, "-o", tmp_path / "run.pdf").output
    assert "can't be written" in tca_report(run, "-o", tmp_path / "nowhere" / "run.html").output
    assert "no such file" in tca_report(tmp_path / "gone", "-o", tmp_path / "run.html").output


def test_report_without_jinja_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    monkeypatch.delitem(sys.modules, "tca_tools.report.page", raising=False)
    result = tca_report(stepping().write(tmp_path / "run"), "-o", tmp_path / "run.html")
    assert result.exit_code == ToolError.exit_code
    assert "pip install 'tca-central[report]'" in result.output


@given(st.lists(FACTS, max_size=80))
@settings(max_examples=8)
def test_arbitrary_facts_make_a_well_formed_report(arbitrary: list[facts.Fact]) -> None:
    history = History.until(
        facts.Entry(number, number // 3, [fact]) for number, fact in enumerate(arbitrary)
    )
    found = contents(history)
    Page(page("run", "", found, tree(history), gantt(history, found), strips(history, found)))
    for shown in (found.path, found.longest):
        for before, after in pairwise(shown.path.steps if shown else []):
            assert before.end == after.start
