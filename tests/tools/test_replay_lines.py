"""What ``tca replay`` shows of many tasks, and the growth of the tree as text."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tools.runs import encoded, walk
from tools.story import Story, arcs, locking, stumbling

from tca_tools.replay.growth import growth_lines
from tca_tools.replay.recording import Living, Recording
from tca_tools.replay.tree import Outline
from tca_wire.journal import facts
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import Wording

# --- what is shown of many -------------------------------------------------------------------------------------------


def crowd(tops: int) -> Recording:
    """Very many goals, of which one in a thousand lives on."""
    story = Story().module("user").module("planner", "walk")
    for number in range(tops):
        goal = story.at(1.0 + number).goal("walk", "user")
        story.delivered(goal, "planner").reached(goal, Moment.START_ACHIEVING).returned(goal)
        if number % 1000:
            story.reached(goal, Moment.END_PLANNING, Moment.END_ACHIEVING)
    return Recording(story.entries)


def test_of_very_many_tasks_a_few_are_shown() -> None:
    recording = crowd(5_000)
    outline = Outline(recording)
    rows = outline.rows(recording.at(recording.last))
    assert outline.living == 5
    assert len(rows) < 20
    assert sum(row.folded or 1 for row in rows) == 5_000
    assert {1, 1001, 2001, 3001, 4001, 5000} <= {row.task for row in rows}
    chosen = outline.rows(recording.at(recording.last), selected=2500)
    assert 2500 in {row.task for row in chosen}


def test_what_lives_is_the_same_however_one_gets_there() -> None:
    recording = Recording(walk())
    walking, times = Living(recording.run), recording.run.times
    for place in [*range(len(times)), *reversed(range(len(times))), 40, 3, 60]:
        walking.move(times[place])
        jumped = Living(recording.run)
        jumped.move(times[place])
        assert {key: set(value) for key, value in walking.below.items()} == {
            key: set(value) for key, value in jumped.below.items()
        }
        at = recording.at(place)
        assert walking.number == sum(Moment.END_ACHIEVING not in task.reached for task in at.tasks.values())


def test_deep_trees_are_drawn() -> None:
    story = Story().module("user").module("planner", "walk")
    parent = 0
    for _ in range(3_000):
        parent = story.goal("walk", "user", parent)
    recording = Recording(story.entries)
    rows = Outline(recording).rows(recording.at(recording.last))
    assert len(rows) == 3_000
    assert max(len(row.guides) for row in rows) < 60


# --- as text ---------------------------------------------------------------------------------------------------------


def test_the_growth_as_text(expect: Callable[[str, str], None]) -> None:
    lines = growth_lines(Recording(stumbling().entries), 0.0, None)
    expect("replay_stumbling", "\n".join(lines) + "\n")


def test_without_a_terminal_it_is_text(tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    command = [sys.executable, "-m", "tca_tools.replay", str(path), "--at", "40"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60, stdin=subprocess.DEVNULL)
    assert done.stdout.split(maxsplit=1)[0] == "42.000"
    assert ": killed, enough" in done.stdout
    assert "\x1b" not in done.stdout


def test_a_damaged_journal_is_replayed_but_for_the_damage(tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    content = bytearray(encoded(walk()))
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    done = subprocess.run([sys.executable, "-m", "tca_tools.replay", str(path), "--text"], capture_output=True, text=True,
                          check=False, timeout=60)  # fmt: skip
    assert done.returncode == 1
    assert "walk {3}: handling" in done.stdout
    assert ": a damaged entry is left out: " in done.stderr


@pytest.mark.parametrize("speed", ["0", "-1", "fast"])
def test_a_speed_that_is_none(speed: str) -> None:
    command = [sys.executable, "-m", "tca_tools.replay", "--speed", speed]
    assert subprocess.run(command, capture_output=True, check=False, timeout=60).returncode == 2


def test_the_arcs_have_waits() -> None:
    lines = list(growth_lines(Recording(arcs().entries), 0.0, 70))
    assert lines
    assert any("waits" in line for line in lines)


def test_locks_have_names_when_they_are_granted_and_over() -> None:
    recording = Recording(locking().entries)
    kinds = (facts.Granted, facts.ClaimEnded)
    told = [fact for event in recording.events for entry in event for fact in entry.facts if isinstance(fact, kinds)]
    assert [Wording(recording.run.name).words(fact) for fact in told] == [
        "lock of legs {90}", "lock of legs {90}: released", "reservation of legs {91}"
    ]  # fmt: skip
