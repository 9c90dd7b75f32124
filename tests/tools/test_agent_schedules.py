"""Tasks sent before their states are entered: figure 7 of the paper from real runs, and marks in
all tools.
"""

import html
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from coordination.delivery_robot import AS_SOON_AS_LIKELY
from tools.deliveries import deliver, figure_7, held_up, killed, too_late, undone, written

from tca_behaviours.coordination import Discrete
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path
from tca_tools.gantt.chart import Bar, BarKind, Chart
from tca_tools.journal.coordinators import coordinators, gain, gains
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.schedule.build import schedules

Tca = Callable[..., Result]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return figure_7(tmp_path_factory.mktemp("figure_7"))


def boxes(one: Chart, agent: str) -> list[Bar]:
    row = next(row for row in one.rows if row.label == agent)
    return [bar for bar in row.handled if bar.kind is not BarKind.IDLE]


def described(box: Bar) -> str:
    return f"{box.name} {box.early_style if box.early_span else 'current'}"


def test_schedule_matches_the_three_runs_of_figure_7(
    tca: Tca, logs: list[Path], expect: Callable[[str, str], None], tmp_path: Path
) -> None:
    result = tca("schedule", *logs, "-o", tmp_path / "figure.txt")
    assert result.exit_code == 0, result.output
    expect("schedule", (tmp_path / "figure.txt").read_text())
    best, occupied, plain = [schedules(folded(open_log(log)), log.name)[0] for log in logs]
    assert best.end < occupied.end < plain.end
    assert [described(box) for box in boxes(best, "arm")] == [
        "arm to(box B) ahead",
        "arm to(tuck) current",
    ]
    assert [described(box) for box in boxes(occupied, "arm")] == [
        "arm to(box B) wasted",
        "arm to(box C) ahead",
        "arm to(tuck) current",
    ]
    assert not any(box.early_span for row in plain.rows for box in row.handled)
    assert (
        boxes(occupied, "arm")[1].end < boxes(occupied, "base")[0].end
    )  # the arm takes C's pose while the base still drives to B


def test_schedule_picture_has_a_box_for_each_task(
    tca: Tca, logs: list[Path], tmp_path: Path
) -> None:
    assert tca("schedule", *logs, "-o", tmp_path / "figure.svg").exit_code == 0
    picture = (tmp_path / "figure.svg").read_text()
    in_legend = 1
    tasks, ahead, wasted = 5 + 7 + 6, 2, 1
    assert picture.count('class="box"') == tasks + in_legend
    assert picture.count('class="ahead"') == ahead + in_legend
    assert picture.count('class="wasted"') == wasted + in_legend
    for log in logs:
        assert f">{log.name}: " in picture
    assert (
        "arm to {8} for the state &#x27;arm to box B&#x27; (ahead, wasted), from 0.000 s to 2.000 s"
        in picture
    )


def test_gain_counts_right_wrong_kept_and_wasted_previews(logs: list[Path]) -> None:
    gains = [
        gain(run, *one) for run in map(folded, map(open_log, logs)) for one in coordinators(run)
    ]
    assert [one._asdict() for one in gains] == [
        pytest.approx(
            {
                "right": right,
                "wrong": wrong,
                "kept": kept,
                "wasted": wasted,
                "restored": 0.0,
                "seconds": length,
            }
        )
        for right, wrong, kept, wasted, length in (
            (1, 0, 3.0, 0.0, 20.0),
            (1, 1, 3.0, 2.0, 28.0),
            (0, 0, 0.0, 0.0, 31.0),
        )
    ]


def test_critical_path_leads_through_awaited_tasks_only(logs: list[Path], tmp_path: Path) -> None:
    """Early tasks that were ready in time, or were wasted, are not on the path. Tasks that undo
    them are.
    """
    drive, grip, reach = ("base", 8.0), ("gripper", 1.0), ("arm", 3.0)
    ways = {
        logs[0]: [drive, grip, reach, drive],
        logs[1]: [drive, drive, grip, reach, drive],
        logs[2]: [drive, drive, reach, grip, reach, drive],
        written(undone(), tmp_path / "undone"): [drive, reach, grip],
        written(too_late(), tmp_path / "too late"): [
            ("coordinate fork", 6.0),
            reach,
        ],  # the user took 6 s
    }
    for log, way in ways.items():
        run = folded(open_log(log))
        ((coordinator, _),) = coordinators(run)
        path = critical_path(run, Causes(run), coordinator)
        steps = [(one.resource, round(one.seconds, 3)) for one in path.steps]
        assert [(resource, seconds) for resource, seconds in steps if seconds > 0] == way


def test_tree_and_gantt_mark_tasks_that_ran_ahead(
    tca: Tca, logs: list[Path], expect: Callable[[str, str], None]
) -> None:
    chart = tca("gantt", logs[1], "--to", 30, COLUMNS="110").stdout.splitlines()
    asked = (("tree",), ("tree", "--at", 3), ("tree", "--story", 8), ("tree", "--story", 11))
    shown = [tca(command, logs[1], *more, COLUMNS="110").stdout for command, *more in asked]
    expect(
        "sent_ahead", "\n".join([*sorted(chart), *shown])
    )  # slots of a module connect in any order


def test_pictures_mark_tasks_that_ran_ahead(tca: Tca, logs: list[Path], tmp_path: Path) -> None:
    pictures = {}
    for name, *asked in (
        ("gantt.svg", "gantt"),
        ("tree.dot", "tree"),
        ("tree.svg", "tree", "--layout", "outline"),
    ):
        assert tca(*asked[:1], logs[1], *asked[1:], "-o", tmp_path / name).exit_code == 0
        pictures[name] = (tmp_path / name).read_text()
    for mark in ("ahead", "wasted"):
        assert pictures["gantt.svg"].count(f'class="{mark}"') == 2  # in the legend, and on a bar
    for name in ("tree.dot", "tree.svg"):
        for meaning in ("by a coordinator: ahead, kept", "by a coordinator: ahead, wasted"):
            assert meaning in pictures[name]
    assert "arm to {11} (ahead, kept) handled by robot / arm" in pictures["gantt.svg"]


def test_report_has_a_row_for_the_gain_of_the_preview(
    tca: Tca, logs: list[Path], run: Path, tmp_path: Path
) -> None:
    for log, row in (
        (logs[1], "1 1 1 3 s 11% 2 s 0 s"),
        (logs[2], "1 0 0 0 s 0.0% 0 s 0 s"),
        (run, ""),
    ):
        page = tmp_path / f"{log.name}.html"
        assert tca("report", log, "-o", page).exit_code == 0
        cells = re.findall(r"<tr><td>deliver</td>(.*)</tr>", page.read_text())
        assert [" ".join(re.findall(r">([^<]+)</td>", one)) for one in cells] == [row] * bool(row)
        assert ("Gain of the preview" in page.read_text()) == bool(row)


def test_late_start_and_its_remedy_are_shown_by_every_tool(
    tca: Tca, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    journal = written(held_up(), tmp_path / "held up")
    ((machine, runs, _, late),) = gains(folded(open_log(journal)))
    ((why, times),) = late.items()
    assert (machine, runs, times) == ("fork", 2, 2)
    logged = [one.message for one in caplog.records if one.name == "tca.coordinator"]
    assert logged == [f"{why.reason}: {why.remedy}"], "logged once for two runs"
    assert "undo=" in why.remedy
    for name, command in (
        ("report.html", "report"),
        ("plan.txt", "schedule"),
        ("plan.svg", "schedule"),
    ):
        assert tca(command, journal, "-o", tmp_path / name).exit_code == 0
        shown = html.unescape(re.sub(r"</text>\s*<[^>]*>", " ", (tmp_path / name).read_text()))
        assert f"{why.reason} {why.remedy}" in " ".join(re.sub("<[^>]*>|;", " ", shown).split())


def test_late_states_are_listed_when_no_task_ran_ahead(tmp_path: Path) -> None:
    never, early = (
        gains(folded(open_log(written(deliver(1.0, policy), tmp_path / name))))[0][3]
        for name, policy in (("never", Discrete(2.0)), ("early", AS_SOON_AS_LIKELY))
    )
    waits = [why.reason.split(" did ")[0] for why in never if not why.remedy]
    assert waits == ["'dropping in B'", "'tucking'", "'going back'"]
    assert not early


def test_undone_preview_is_shown_with_its_restoring_task(tca: Tca, tmp_path: Path) -> None:
    log = written(undone(), tmp_path / "undone")
    run = folded(open_log(log))
    ((task, record),) = coordinators(run)
    found = gain(run, task, record)
    assert (found.right, found.wrong, found.wasted, found.restored) == pytest.approx(
        (0, 1, 3.0, 3.0)
    )
    (plan,) = schedules(run, log.name)
    assert [described(box) for box in boxes(plan, "arm")] == [
        "arm to(box B) wasted",
        "undo arm to(home) current",
    ]
    restoring = next(
        one.id for one in record.tasks.values() if not one.is_early and one.agent == "arm"
    )
    assert f"arm to {{{restoring}}} (restoring)" in tca("tree", log).stdout
    story = tca("tree", log, "--story", restoring).stdout
    assert "undoes wasted work ahead of the state 'free'" in story


def test_preview_of_a_killed_run_counts_as_wasted(tca: Tca, tmp_path: Path) -> None:
    log = written(killed(), tmp_path / "killed")
    run = folded(open_log(log))
    ((task, record),) = coordinators(run)
    found = gain(run, task, record)
    assert (found.right, found.wrong, found.kept, found.wasted) == pytest.approx((0, 1, 0.0, 2.0))
    (plan,) = schedules(run, log.name)
    assert [described(box) for box in boxes(plan, "arm")] == ["arm to(box B) wasted"]


def test_schedule_fails_without_a_coordinator_in_the_run(tca: Tca, run: Path) -> None:
    result = tca("schedule", run)
    assert result.exit_code == 1
    assert "run: no coordinator has started a task in this run" in result.stderr
