"""Rocks that the scanner does not see, in real processes. Each level of recovery (paper, figure 3)
is checked in the journal.
"""

import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import CliRunner
from sampling import lives

from robots.ambler_sim.run.rules import FOOTFALL, PLANNED_AHEAD, RULES, STABILITY
from tca_tools.check.__main__ import check
from tca_tools.check.rules import RULES as RULES_OF_TASKS
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_tools.journal.records import Task, TaskState
from tca_wire.vocabulary import Outcome, Role

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]

LOW = "1.1 1.85 0.25 0.7"
TALL = "1.1 0.9 0.25 1.9"
"""A rock that is taller than a leg is raised. The leg swings around the rock."""

BROAD = "1.4 0.3 0.7 1.9"
"""A rock that is too broad for a leg to go around, until the feet are shuffled."""

HUGE = "3.2 0.0 2.4 1.9"
"""A rock that no leg passes, so that the walk is given up there."""

UNCHECKED = ("--without", "stability", "--without", "footfall")

METRES = str(lives(8, 15))
"""The length of the walk with faults. In 8 m there are too few steps for one of the rules."""

LADDER = ("raise leg", "replan move", "shuffle feet", "give up")


class Walk(NamedTuple):
    folder: Path
    output: str
    code: int
    history: History

    @property
    def recoveries(self) -> dict[str, int]:
        return Counter(
            task.name for task in self.history.tasks.values() if task.role is Role.EXCEPTION
        )

    def named(self, *names: str) -> list[Task]:
        return [task for task in self.history.tasks.values() if task.name in names]


def walk(folder: Path, *options: str) -> Walk:
    command = [
        sys.executable,
        "-m",
        "robots.ambler_sim",
        "--out",
        str(folder / "walk"),
        "--pace",
        "0",
        "--arcs",
        "1",
    ]
    done = subprocess.run(
        [*command, *options], cwd=ROOT, capture_output=True, text=True, timeout=150, check=False
    )
    history = History.until(open_log(folder / "walk" / "journal"))
    return Walk(folder / "walk", done.stdout + done.stderr, done.returncode, history)


def walk_with(
    folder: Path,
    rock: str,
    metres: str = "2",
    backend: str = "kinematic",
    options: tuple[str, ...] = (),
) -> Walk:
    return walk(
        folder, "--backend", backend, "--distance", metres, "--rock", *rock.split(), *options
    )


Walks = Callable[[str], Walk]


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Walks:
    """Return a function that walks to a rock, once for each rock."""
    known: dict[str, Walk] = {}

    def get(rock: str) -> Walk:
        if rock not in known:
            known[rock] = walk_with(tmp_path_factory.mktemp("rock"), rock)
        return known[rock]

    return get


@pytest.fixture(scope="module")
def given_up(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    """Walk to the huge rock without checks. The walk breaks rules before it is given up."""
    return walk_with(tmp_path_factory.mktemp("huge"), HUGE, options=UNCHECKED)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    """Walk over hills of 30 %, on which each fault occurs."""
    options = [text for fault in FAULTS for text in ("--fault", fault)]
    folder = tmp_path_factory.mktemp("faults")
    return walk(
        folder, "--backend", "kinematic", "--distance", METRES, "--terrain", "hills", *options
    )


def assert_walked(walk: Walk) -> None:
    assert walk.code == 0, walk.output
    (path,) = walk.named("traverse path")
    assert path.state is TaskState.ACHIEVED


@pytest.mark.soak
@pytest.mark.parametrize("backend", ["kinematic", "pybullet"])
def test_leg_is_raised_over_a_low_rock(backend: str, tmp_path: Path) -> None:
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    done = walk_with(tmp_path, LOW, metres="1", backend=backend)
    assert_walked(done)
    assert done.recoveries == {"raise leg": 1}
    (raised,) = done.named("raise leg")
    leg_move = done.history.tasks[raised.parent]
    assert [handling.outcome for handling in leg_move.handlings] == [Outcome.FAILED, Outcome.DONE]


@pytest.mark.soak
def test_step_is_replanned_around_a_tall_rock(walked: Walks) -> None:
    done = walked(TALL)
    assert_walked(done)
    assert done.recoveries.keys() == {"raise leg", "replan move"}
    replanned = done.named("replan move")[0]
    assert names_under(done, replanned) == ["move leg", "move body", "achieved position?"]
    failing = done.history.tasks[replanned.parent]
    assert failing.name == "move leg"
    tried = [name for name in names_under(done, failing) if name in LADDER]
    assert tried == ["raise leg", "raise leg", "replan move"]
    step = done.history.tasks[failing.parent]
    assert (step.name, len(step.handlings)) == ("take steps", 2)  # the step was planned twice


def names_under(walk: Walk, task: Task) -> list[str]:
    return [walk.history.tasks[child].name for child in task.children]


@pytest.mark.soak
def test_feet_are_shuffled_when_replanning_fails(walked: Walks) -> None:
    done = walked(BROAD)
    assert_walked(done)
    assert done.recoveries.keys() >= {"raise leg", "replan move", "shuffle feet"}
    shuffled = done.named("shuffle feet")
    first, *moves = names_under(done, shuffled[0])
    assert first in (
        "move body",
        "move leg",
    )  # the body may move first, so that any leg can be lifted
    assert set(moves) == {"move leg"}
    (arc,) = done.named("traverse arc")
    assert len(arc.handlings) == 1 + len(
        shuffled
    )  # restarted each time, from the standard configuration


@pytest.mark.soak
def test_walk_is_given_up_when_no_recovery_helps(given_up: Walk) -> None:
    assert given_up.code == 1
    assert given_up.recoveries.keys() >= set(LADDER)
    text = " ".join(given_up.output.split())
    assert "the walk failed: traverse path {" in text
    assert "walk given up" in text
    (path,) = given_up.named("traverse path")
    assert path.state in (TaskState.KILLED, TaskState.FAILED)


@pytest.mark.soak
def test_recoveries_are_tried_from_the_leg_up(given_up: Walk) -> None:
    assert len(given_up.named("give up")) == 1
    firsts = [min(one.id for one in given_up.named(name)) for name in LADDER]
    assert firsts == sorted(firsts)


@pytest.mark.soak
@pytest.mark.parametrize("rock", [TALL, BROAD])
def test_each_move_is_checked_past_a_rock(walked: Walks, rock: str) -> None:
    assert_moves_checked(walked(rock).history)


def test_each_move_is_checked_under_faults(
    faulty: Walk,
) -> None:
    assert_moves_checked(faulty.history)


def assert_moves_checked(history: History) -> None:
    before, after = STABILITY.count(history), FOOTFALL.count(history)
    assert (before.bad, after.bad) == ([], [])
    assert before.number >= 8
    assert after.number >= 4


@pytest.mark.soak
def test_walk_output_names_the_broken_rules(given_up: Walk) -> None:
    lines = given_up.output.splitlines()
    broken = {line.partition(": ")[2].partition(": ")[0] for line in lines if "broken: " in line}
    assert broken == {str(STABILITY), str(FOOTFALL)}


@pytest.mark.soak
def test_sequential_walk_breaks_the_planned_ahead_rule(tmp_path: Path) -> None:
    done = walk(tmp_path, "--backend", "kinematic", "--distance", "12", "--mode", "sequential")
    assert_walked(done)
    assert f"broken: {PLANNED_AHEAD}" in " ".join(done.output.split())


@pytest.mark.soak
def test_bare_walk_succeeds_without_monitors_and_recovery(tmp_path: Path) -> None:
    done = walk(tmp_path, "--backend", "kinematic", "--distance", "1", "--bare")
    assert_walked(done)
    assert not {"stability layer", "error recovery"} & done.history.modules.keys()
    assert not done.named("stability check", "footfall check", *LADDER)


@pytest.mark.soak
def test_bare_walk_fails_at_a_low_rock(tmp_path: Path) -> None:
    done = walk(
        tmp_path, "--backend", "kinematic", "--distance", "1", "--bare", "--rock", *LOW.split()
    )
    assert done.code == 1
    assert "terrain collision" in done.output


FAULTS = {
    "amplifier trip@2": "switch on",
    "stuck joint@4": "free leg",
    "motion fault@6": "free leg",
    "no image@9": "look again",
    "bad image@11": "look again",
    "unseen rock@13": "raise leg",
    "no footfall@15": "plan otherwise",
    "soft spot@16": "",
    "lost module@18": "do again",
    "lost central@20": "",
    "lost module@22": "do again",
}


def test_walk_recovers_from_every_fault(faulty: Walk) -> None:
    """Each fault is followed by its recovery, and the run keeps the rules of task-level control."""
    assert_walked(faulty)
    assert {name for name in FAULTS.values() if name} <= faulty.recoveries.keys()
    assert "1 of 1 amplifier trip" in faulty.output
    assert "1 of 1 unseen rock" in faulty.output
    assert "1 of 1 soft spot" in faulty.output
    number = len(RULES_OF_TASKS) + len(RULES) - lives(1, 0)
    assert f"rules kept: {number} of {number}" in faulty.output
    assert "1 of 1 lost central, 2 of 2 lost module" in faulty.output
    assert all(task.state is TaskState.ACHIEVED for task in faulty.named("traverse arc"))
    journal, rules = faulty.folder / "journal", ROOT / "robots/ambler_sim/run/rules.py"
    good = CliRunner().invoke(check, [str(journal), str(rules)])
    assert good.exit_code == 0, good.output
