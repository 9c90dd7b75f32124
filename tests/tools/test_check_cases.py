"""Properties that count the cases of a whole run, in ``tca check`` and in the explorer."""

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


def test_cases_are_counted_and_bad_cases_are_named(journal: Path, file: Path) -> None:
    result = run(journal, file)
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    assert (
        lines.count("good: step has moves, in all cases (2 of 2)") == 1
    )  # listed twice in the file
    assert "good: step is the first, in at least 50 % of cases (1 of 2)" in lines
    assert (
        "good: jump has moves, in all cases (which says nothing: in this run there was no case of it)"
        in lines
    )
    broken = next(number for number, line in enumerate(lines) if line.startswith("BROKEN"))
    assert lines[broken].endswith(": step is the first, in all cases")
    assert lines[broken + 1] == "  true in 1 of 2 cases, not for step {5}"
    assert lines[broken + 2] == "  the story of step {5} until then:"


def test_case_share_is_not_judged_for_a_torn_journal(tmp_path: Path, file: Path) -> None:
    torn = tmp_path / "torn.tcaj"
    torn.write_bytes(encoded(walk())[:-7])
    result = run(torn, file)
    assert result.exit_code == 0
    assert "no breach in the readable part: step is the first, in all cases\n" in result.stdout
    assert "good:" not in result.stdout


@pytest.mark.parametrize("case", ["task", "(task, 1)", "(task.id, True)", "(task, True, 'why')"])
def test_case_must_be_a_message_and_a_truth_value(journal: Path, tmp_path: Path, case: str) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        "from tca_tools.properties import in_all_cases\ndef it(run):\n    for task in run.tasks.values():\n"
        f"        yield {case}\nIT = in_all_cases(it)\n"
    )
    result = run(journal, file)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "property 'it, in all cases' can't be asked: TypeError: it yielded " in result.stderr


def test_share_is_one_when_the_run_has_no_cases() -> None:
    counted = in_at_least(1, lambda _run: []).count(History())
    assert (counted.share, str(counted)) == (1.0, "0 of 0")


@pytest.mark.parametrize("share", [-0.1, 90, True, "0.9"])
def test_share_outside_0_to_1_is_refused(share: object) -> None:
    with pytest.raises(BadProperty, match="needs a share from 0 to 1"):
        in_at_least(share, lambda _run: [])  # type: ignore[arg-type]


def test_share_is_not_judged_when_cases_are_too_few(journal: Path, tmp_path: Path) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        "from tca_tools.properties import in_at_least\ndef it(run):\n    for task in run.tasks.values():\n"
        "        yield task, False\nFEW = in_at_least(0.9, it, fewest=100)\n"
    )
    result = run(journal, file)
    assert result.exit_code == 0
    assert "cases of it, and it needs 100" in result.stdout


@pytest.mark.parametrize("fewest", [0, True, 2.5])
def test_fewest_must_be_an_integer_of_one_or_more(fewest: object) -> None:
    with pytest.raises(BadProperty, match="fewest must be a whole number from 1, not"):
        in_at_least(0.9, lambda _run: [], fewest=fewest)  # type: ignore[arg-type]


def test_in_all_cases_refuses_a_text() -> None:
    with pytest.raises(BadProperty, match="cases must be a function of the run"):
        in_all_cases("step begun")  # type: ignore[arg-type]


def test_scenario_refuses_properties_of_a_whole_run() -> None:
    with pytest.raises(
        ScenarioError,
        match="'it, in all cases' counts the cases of a whole run: check it with tca check",
    ):
        Scenario("walking", in_all_cases(it))


def it(_run: object) -> list[tuple[object, bool]]:
    return []
