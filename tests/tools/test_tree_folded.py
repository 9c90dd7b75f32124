"""What a large tree shows of what was killed, of many jobs alike, and of more rows than a picture may have."""

from collections.abc import Callable
from pathlib import Path

from click.testing import Result
from tools.story import Story

from tca_tools.run.at_time import RunAt
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import Row, cut_off, outline
from tca_wire.journal.facts import Failed, Killed
from tca_wire.points import Moment, TaskId

Tca = Callable[..., Result]
WHY = "failure 'bad part' was not handled"


def jobs(good: int, bad: int, parts: int = 30) -> Story:
    """Jobs of parts of two steps each: first those that went well; of each other one a step of part 10 failed, and all
    that was to come of it was killed, but for a step that was done.
    """
    story = Story()
    for number in range(good + bad):
        job = story.goal("job", "x")
        above = [story.goal("part", "boss", job) for _ in range(parts)]
        steps = [story.command("step", "boss", part) for part in above for _ in range(2)]
        if number < good:
            story.reached(job, *Moment)
            for task in (*above, *steps):
                story.reached(task, *Moment)
            continue
        for task in (*above[:10], *steps[:20], steps[-1]):
            story.reached(task, *Moment)
        story.say(Failed(TaskId(steps[20]), "bad part", "burr"))
        for task in (*steps[21:-1], *above[10:], job):
            story.say(Killed(TaskId(task), WHY)).reached(task, *Moment)
    return story


def told(rows: list[Row]) -> list[str]:
    return [f"{row.task.name} {row.task.state}" if row.task else words.folded(row) for row in rows]


def test_what_was_killed_with_what_it_was_under_is_folded_around_what_failed() -> None:
    rows = outline(RunAt(jobs(0, 10).fold()), budget=20)
    assert len(rows) == 10 * 6
    assert told(rows[:6]) == [
        "job killed",
        "+ 30 tasks achieved",
        "part killed",
        "step failed",
        "+ 1 task killed",
        "+ 57 tasks: 1 achieved, 56 killed",
    ]


def test_whole_jobs_stay_and_of_many_the_first_and_last() -> None:
    few, many = (told(outline(RunAt(jobs(good, 0).fold()), budget=20)) for good in (10, 40))
    assert few == ["job achieved", "+ 90 tasks achieved"] * 10
    assert many[:5] == ["job achieved", "+ 90 tasks achieved"] * 2 + [f"+ {36 * 91:,} tasks achieved"]
    assert many[5:] == ["job achieved", "+ 90 tasks achieved"] * 2


def test_who_was_killed_for_a_reason_of_his_own_is_shown() -> None:
    story = jobs(0, 4)
    story.say(Killed(TaskId(20), "not needed any more"))
    rows = outline(RunAt(story.fold()), budget=1)
    assert 20 in [row.task.id for row in rows if row.task]


def test_rows_beyond_what_a_picture_has_are_counted() -> None:
    rows = outline(RunAt(jobs(0, 10).fold()), budget=20)
    assert cut_off(rows, 60) == rows
    assert told(cut_off(rows, 54)[-1:]) == ["+ 91 tasks further down"]


def test_a_picture_of_very_many_rows_ends_and_says_so(tca: Tca, tmp_path: Path) -> None:
    run = jobs(0, 100, parts=11).write(tmp_path / "run")
    assert tca("tree", run, "-o", tmp_path / "tree.svg").exit_code == 0
    picture = (tmp_path / "tree.svg").read_text()
    assert picture.count('class="name"') < 320
    assert "tasks further down<" in picture
    assert "folded up; a part of the tree" in picture
