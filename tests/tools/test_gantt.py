"""``tca gantt``: the bars of a chart, their texts, its time span, and the chart as text."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.story import COMMAND, THIS, Story, locking, made, silent_for, stumbling, walking
from tools.telling import bar_lines

from tca_tools.gantt.axis import ticks
from tca_tools.gantt.blocks import in_blocks, queue_lengths, share_of
from tca_tools.gantt.build import SUSPENDED, chart
from tca_tools.gantt.chart import BarKind, Chart, ResourceRow
from tca_tools.gantt.text import chart_lines
from tca_tools.gantt.window import ALL, Pick
from tca_tools.journal.fold import History
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass

Tca = Callable[..., Result]
Expect = Callable[[str, str], None]
NOW = 1000.0


def labels(drawing: Chart) -> list[str]:
    return [row.label for row in drawing.rows]


def row_of(story: Story, label: str, pick: Pick = ALL) -> ResourceRow:
    return next(row for row in chart(story.fold(), pick=pick).rows if row.label == label)


# --- approved -------------------------------------------------------------------------------------


def test_bars_match_their_transcript(expect: Expect) -> None:
    drawings = [
        chart(stumbling().fold()),
        chart(locking().fold()),
        chart(walking().fold(), pick=Pick(messages={2, 3}, context={5}, held={3})),
    ]
    expect(
        "gantt_bars",
        "\n".join(line for drawing in drawings for line in bar_lines(drawing)) + "\n",
    )


def test_text_charts_match_their_transcript(
    tca: Tca, run: Path, tmp_path: Path, expect: Expect
) -> None:
    walk, locks = walking().write(tmp_path / "walk"), locking().write(tmp_path / "locks")
    shown = [
        tca("gantt", run, COLUMNS="100"),
        tca("gantt", run, "--ascii", "--from", 0.5, "--to", 2.5, COLUMNS="72"),
        tca("gantt", locks, COLUMNS="100"),
        tca("gantt", locks, "--story", 4, "--ascii", COLUMNS="100"),
        tca("gantt", walk, "--story", 1, COLUMNS="100"),
    ]
    expect("gantt", "\n".join(one.stdout for one in shown))


# --- rows and bars --------------------------------------------------------------------------------


def test_idle_module_has_a_row_from_its_connection_on(tca: Tca, tmp_path: Path) -> None:
    story = (
        Story()
        .module("legs", "move")
        .module("user")
        .at(5.0)
        .module("lamp", "shine", resource="bulb")
    )
    story.at(10.0).acted(story.command("move", "user"), "legs", 10.0)
    story.at(30.0).acted(story.command("move", "user"), "legs", 10.0)
    log = story.write(tmp_path / "run")
    lines = tca("gantt", log, "--from", 0, "--ascii", COLUMNS="52").stdout.splitlines()
    assert lines[3:6] == [
        "legs                   # move ##|         # move ##|",
        "lamp / bulb       __________________________________",
        "",
    ]
    assert lines[-1].endswith("__ connected")
    asked = tca("gantt", log, "--module", "user", "--ascii", COLUMNS="52").stdout.splitlines()
    assert asked[3] == "user  " + "_" * 46


def test_part_of_a_run_keeps_the_message_colours() -> None:
    whole, part = chart(stumbling().fold()), chart(stumbling().fold(), 3.0, 4.0)
    assert (
        part.names
        == whole.names
        == ["traverse arc", "take steps", "elevation map", "move leg", "move body"]
    )
    assert [len(row.handled) for row in part.rows] == [1, 0, 0, 2]


def test_suspended_task_is_in_the_row_of_its_module() -> None:
    """Its module is the one that would have handled the task, even if the module has left."""
    run = made("suspended_for_wheels").fold()

    def suspended(*modules: str) -> list[float]:
        rows = chart(run, pick=Pick(modules=modules) if modules else ALL).rows
        return [bar.start for row in rows for bar in row.queued if bar.kind is BarKind.SUSPENDED]

    assert (suspended(), suspended("wheels"), suspended("legs")) == ([1.0, 4.0], [1.0], [])


def test_each_hold_reason_is_a_bar_in_the_lane_of_its_task() -> None:
    drawing = chart(made("two_waiting").fold(), pick=Pick(held={3, 4}))
    (row,) = (row for row in drawing.rows if row.held)
    assert sorted((bar.lane, bar.start, bar.end, bar.reason(200)) for bar in row.held) == [
        (0, 1.0, 3.0, "move {3}: until move {1} and look {2} are achieved"),
        (0, 3.0, 4.0, "until look {2} is achieved"),
        (1, 1.0, 3.0, "move {4}: until move {1} and look {2} are achieved"),
        (1, 3.0, 4.0, "until look {2} is achieved"),
    ]
    lines = [line for line in chart_lines(drawing, 120) if "until" in line]
    assert [line.count("╎ until look {2} is achieved ·") for line in lines] == [1, 1]


# --- selection ------------------------------------------------------------------------------------


def test_module_option_limits_the_rows(tca: Tca, run: Path) -> None:
    drawing = chart(walking().fold(), pick=Pick(frozenset({"controller", "perception"})))
    assert labels(drawing) == ["perception", "controller"]
    wrong = tca("gantt", run, "--module", "controler").stderr
    assert "no module 'controler' in this journal: did you mean 'controller'?" in wrong


def test_task_option_keeps_the_subtree_and_its_queries(tca: Tca, run: Path) -> None:
    shown = tca("gantt", run, "--task", 3).stdout
    assert [line.split("  ")[0] for line in shown.splitlines()[3:6]] == [
        "gait planner",
        "",
        "perception",
    ]
    assert "controller" not in shown  # take steps {3} sent it nothing
    assert "held" not in shown  # only a story shows holds
    assert (
        "controller" in tca("gantt", run, "--task", "take steps").stdout
    )  # all tasks of that name


def test_unusable_task_or_story_option_is_explained(tca: Tca, run: Path) -> None:
    for asked, reason in (
        (
            ("--task", "take step"),
            "no task 'take step' in this journal: did you mean 'take steps'?",
        ),
        (("--task", 99), "no task '99' in this journal"),
        (
            ("--task", 5),
            "elevation map {5} is a query, not a task: 'tca tree --story 5' tells its story",
        ),
        (
            ("--story", "take steps"),
            "3 tasks are called 'take steps': name one by its number: 2, 3, 4",
        ),
    ):
        result = tca("gantt", run, *asked)
        assert result.exit_code == 1
        assert reason in result.stderr
    assert tca("gantt", run, "--task", 1, "--story", 1).exit_code == 2


def test_gantt_refuses_a_span_that_ends_before_it_begins(tca: Tca, run: Path) -> None:
    result = tca("gantt", run, "--from", 3, "--to", 2)
    assert (result.exit_code, "3 is not before the end, 2" in result.stderr) == (2, True)


def test_at_option_shows_the_chart_as_it_was(tca: Tca, run: Path) -> None:
    then = tca("gantt", run, "--at", 2.0, COLUMNS="100").stdout
    assert then.splitlines()[0] == "run: 0.47 to 2.00 s"
    assert "move body" not in then
    part = tca("gantt", run, "--from", 1.0, "--to", 4.0, COLUMNS="100").stdout
    assert part.splitlines()[0] == "run: 1.00 to 4.00 s"
    assert "█!" in part  # open at 4.0 s, failed later


# --- default time span ----------------------------------------------------------------------------


def now_of(story: Story, *, is_live: bool = True) -> History:
    """Return the run, long after its last message."""
    history = story.fold()
    history.time, history.is_live = NOW, is_live
    return history


def moved() -> Story:
    """Return a single move, from second 10 to second 20."""
    story = Story().module("legs", "move").at(10.0)
    return story.acted(story.command("move", "user"), "legs", 10.0)


@pytest.mark.parametrize("is_live", [True, False])
def test_chart_of_an_ended_run_ends_with_the_last_bar(is_live: bool) -> None:
    history = now_of(moved(), is_live=is_live)
    drawing = chart(history)
    assert (drawing.start, drawing.end) == pytest.approx((9.8, 20.2))
    assert (chart(history, 5.0, 900.0).start, chart(history, 5.0, 900.0).end) == (5.0, 900.0)


def test_gantt_and_report_of_a_quiet_run_end_with_the_last_bar(tca: Tca, tmp_path: Path) -> None:
    folder = moved().write(tmp_path / "run")
    with silent_for(folder, 600.0):
        assert tca("gantt", folder).stdout.startswith("run: 9.80 to 20.20 s\n")
        tca("report", folder, "-o", tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    marks = re.findall(r'class="faint tick[^>]*>(\d+) s<', page)
    assert (marks[0], marks[-1]) == ("10", "20")


def test_chart_of_a_live_run_with_open_work_extends_to_now() -> None:
    moving, waiting, monitored = Story().module("legs", "move").at(10.0), moved(), moved()
    moving.delivered(moving.command("move", "user"), "legs")
    waiting.queued(waiting.command("fly", "user"))
    monitored.at(30.0).received(
        "watch", MessageClass.POINT_MONITOR, "user"
    )  # a monitor that has not begun to watch
    for story in (walking(), moving, waiting, monitored):
        assert chart(now_of(story)).end == NOW


def test_held_task_extends_a_live_chart_to_now() -> None:
    story = moved()
    arm = story.at(21.0).command("grip", "user")
    story.command("move", "user", 0, sequential_achievement(TaskId(arm), THIS))
    assert chart(now_of(story)).end == NOW
    assert chart(now_of(story), pick=Pick(messages=[1])).end == pytest.approx(20.2)
    assert chart(now_of(story, is_live=False)).end < 30.0


def test_held_lock_and_open_monitor_do_not_extend_the_chart() -> None:
    story = (
        moved()
        .at(25.0)
        .module("eyes")
        .say(facts.Claimed(90, "legs", "legs", False, "eyes", TaskId(0)))
    )
    story.say(facts.Granted(90))
    monitor = story.received("look", MessageClass.DEMON_MONITOR, "user", to="legs")
    story.returned(monitor)
    assert 25.0 < chart(now_of(story)).end < 26.0
    story.at(40.0).say(facts.ClaimEnded(90, "released"))
    assert 40.0 < chart(now_of(story)).end < 41.0


def test_story_chart_spans_the_life_of_its_task(tmp_path: Path, tca: Tca) -> None:
    story = Story().module("legs", "move").module("user").at(1.0)
    first, second = story.command("move", "user"), story.command("move", "user")
    story.queued(second, "legs").acted(first, "legs", 1.0).acted(second, "legs", 1.0)
    story.at(50.0).say(facts.WaitBegan("user", 0, TaskId(first), Moment.END_ACHIEVING)).at(60.0)
    story.say(facts.WaitEnded("user", 0, TaskId(first))).at(70.0)
    folder = story.write(tmp_path / "late")
    for asked, title in (
        ((second,), "story of 2: 1.00 to 3.04 s"),
        ((second, "--to", 9), "story of 2: 1.00 to 9.00 s"),
        ((second, "--from", 0), "story of 2: 0.00 to 3.04 s"),
        ((first,), "story of 1: 1.00 to 2.02 s"),
        ((first, "--at", 1.5), "story of 1: 1.00 to 1.50 s"),
    ):
        assert tca("gantt", folder, "--story", *asked).stdout.splitlines()[0] == f"late, {title}"


# --- many, short and unusual bars -----------------------------------------------------------------


def test_gantt_lines_fit_the_terminal(tca: Tca, run: Path) -> None:
    for width in (20, 40, 133):
        assert max(map(len, tca("gantt", run, COLUMNS=str(width)).stdout.splitlines())) <= width


def test_text_chart_of_an_empty_run_has_four_lines() -> None:
    assert len(list(chart_lines(chart(Story().fold()), 80))) == 4


def test_narrow_bars_merge_only_with_neighbours() -> None:
    story = Story().module("legs", "step")
    for number in range(3):
        story.at(float(number)).acted(story.command("step", "x"), "legs", 0.01)
    wide, blocks = in_blocks(row_of(story, "legs").handled, 0.0, 2.0, 0.5)
    assert ([bar.start for bar in wide], [len(block.parts) for block in blocks]) == ([2.0], [2])
    assert (round(blocks[0].start, 6), blocks[0].end, round(share_of(blocks[0]), 3)) == (
        0.0,
        1.01,
        0.02,
    )


@pytest.mark.parametrize("is_suspended", [True, False])
def test_long_queue_shows_the_number_of_waiting_messages(
    tca: Tca, tmp_path: Path, *, is_suspended: bool
) -> None:
    story = Story().module("legs", "step")
    ids = [story.at(number * 1.0).received("step", COMMAND, "x") for number in range(40)]
    for number in ids:
        if is_suspended:
            story.say(facts.SuspendedOrResumed(TaskId(number), True))
        else:
            story.queued(number, "legs")
    for number in ids:
        story.at(100.0 + number).say(
            *[facts.SuspendedOrResumed(TaskId(number), False)] * is_suspended
        )
        story.delivered(number, "legs").returned(number)
    row = row_of(story, SUSPENDED if is_suspended else "legs")
    assert max(number for *_, number in queue_lengths(row.queued, 0.0, 10.0)) == 40
    shown = tca("gantt", story.write(tmp_path / "run"), COLUMNS="100").stdout
    assert ("┄ 40 ┄" if is_suspended else "░ 40 ░") in shown


def test_short_wait_is_not_drawn_as_handling() -> None:
    """A wait of 1 ms takes less than one column, but it must not become a block of handling."""
    story = Story().module("legs", "move").module("guest").at(1.0)
    story.say(facts.Claimed(90, "legs", "legs", False, "guest", TaskId(0))).at(1.001).say(
        facts.Granted(90)
    )
    story.at(1.5).say(facts.ClaimEnded(90, "released")).at(2.0)
    story.acted(story.command("move", "user"), "legs", 20.0)
    lines = {line[:5].strip(): line for line in chart_lines(chart(story.fold()), 60)}
    assert ("▒" in lines["guest"], "█" in lines["guest"]) == (True, False)


@pytest.mark.parametrize(
    ("start", "end", "labels"),
    [
        (0, 5, ["0 s", "1 s", "2 s", "3 s", "4 s", "5 s"]),
        (0.1, 0.52, ["0.1 s", "0.2 s", "0.3 s", "0.4 s", "0.5 s"]),
        (0, 0.0021, ["0.0000 s", "0.0005 s", "0.0010 s", "0.0015 s", "0.0020 s"]),
        (100, 250, ["2:00", "2:30", "3:00", "3:30", "4:00"]),
        (0, 4000, ["0:00", "15:00", "30:00", "45:00", "1:00:00"]),
        (0, 400_000, ["0:00", "24:00:00", "48:00:00", "72:00:00", "96:00:00"]),
        (2, 2, ["2 s"]),
    ],
)
def test_ticks_are_at_round_times(start: float, end: float, labels: list[str]) -> None:
    assert [label for _, label in ticks(start, end, 5)] == labels
