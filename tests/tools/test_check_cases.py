"""Properties of the cases of a whole run: what ``tca check`` says of them, and what the explorer
does.
"""

from pathlib import Path

import pytest
from tools.runs import encoded, walk
from tools.test_check_command import run, written

from tca_tools.explore import Scenario
from tca_tools.explore.errors import ScenarioError
from tca_tools.journal.fold import History
from tca_tools.properties import BadProperty, in_all_cases, in_at_least

FILE = """
from tca_tools.properties import in_all_cases, in_at_least

def step_has_moves(run):
    for task in run.tasks.values():
        if task.name == "step":
            yield task, any(run.tasks[child].name == "move" for child in task.children)

def step_is_the_first(run):
    steps = [task for task in run.tasks.values() if task.name == "step"]
    for task in steps:
        yield task, task is steps[0]

def jump_has_moves(run):
    return ((task, True) for task in run.tasks.values() if task.name == "jump")

MOVES = in_all_cases(step_has_moves)
ALL = [MOVES, in_all_cases(step_is_the_first), in_at_least(0.5, step_is_the_first), in_all_cases(jump_has_moves)]
"""


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    return written(tmp_path / "walk.tcaj", walk())


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "properties.py"
    path.write_text(FILE)
    return path


def test_cases_are_counted_and_those_that_are_bad_named(journal: Path, file: Path) -> None:
    result = run(journal, file)
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    assert (
        lines.count("good: step has moves, in all cases (2 of 2)") == 1
    )  # though it stands there twice
    assert "good: step is the first, in at least 50 % of cases (1 of 2)" in lines
    assert (
        "good: jump has moves, in all cases (which says nothing: in this run there was no case of it)"
        in lines
    )
    broken = next(number for number, line in enumerate(lines) if line.startswith("BROKEN"))
    assert lines[broken].endswith(": step is the first, in all cases")
    assert lines[broken + 1] == "  true in 1 of 2 cases, not for step {5}"
    assert lines[broken + 2] == "  the story of step {5} until then:"


def test_of_a_run_that_is_not_known_whole_nothing_is_said(tmp_path: Path, file: Path) -> None:
    torn = tmp_path / "torn.tcaj"
    torn.write_bytes(encoded(walk())[:-7])
    result = run(torn, file)
    assert result.exit_code == 0
    assert "no breach in the readable part: step is the first, in all cases\n" in result.stdout
    assert "good:" not in result.stdout


@pytest.mark.parametrize("case", ["task", "(task, 1)", "(task.id, True)", "(task, True, 'why')"])
def test_a_case_is_a_message_and_a_truth_value(journal: Path, tmp_path: Path, case: str) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        "from tca_tools.properties import in_all_cases\ndef it(run):\n    for task in run.tasks.values():\n"
        f"        yield {case}\nIT = in_all_cases(it)\n"
    )
    result = run(journal, file)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "property 'it, in all cases' can't be asked: TypeError: it yielded " in result.stderr


def test_a_run_without_cases_has_none_that_is_bad() -> None:
    counted = in_at_least(1, lambda _run: []).count(History())
    assert (counted.share, str(counted)) == (1.0, "0 of 0")


@pytest.mark.parametrize("share", [-0.1, 90, True, "0.9"])
def test_a_share_is_from_0_to_1(share: object) -> None:
    with pytest.raises(BadProperty, match="needs a share from 0 to 1"):
        in_at_least(share, lambda _run: [])  # type: ignore[arg-type]


def test_of_too_few_cases_a_share_is_not_judged(journal: Path, tmp_path: Path) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        "from tca_tools.properties import in_at_least\ndef it(run):\n    for task in run.tasks.values():\n"
        "        yield task, False\nFEW = in_at_least(0.9, it, fewest=100)\n"
    )
    result = run(journal, file)
    assert result.exit_code == 0
    assert "cases of it, and it needs 100" in result.stdout


@pytest.mark.parametrize("fewest", [0, True, 2.5])
def test_the_fewest_cases_are_one(fewest: object) -> None:
    with pytest.raises(BadProperty, match="fewest must be 1 or more"):
        in_at_least(0.9, lambda _run: [], fewest=fewest)  # type: ignore[arg-type]


def test_cases_come_from_a_function() -> None:
    with pytest.raises(BadProperty, match="cases must be a function of the run"):
        in_all_cases("step begun")  # type: ignore[arg-type]


def test_the_explorer_has_no_whole_runs() -> None:
    with pytest.raises(
        ScenarioError,
        match="'it, in all cases' counts the cases of a whole run: check it with tca check",
    ):
        Scenario("walking", in_all_cases(it))


def it(_run: object) -> list[tuple[object, bool]]:
    return []
