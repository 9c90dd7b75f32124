import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from tca_tools.explore.command import explore_file

ROOT = Path(__file__).parents[2]
SCENARIO = """
from tca_tools.explore import Scenario, never, handled
from tca_wire.messages.declarations import Command
STEP = Command("step")
GOOD = Scenario("good one")
BAD = Scenario("bad one", never(handled(STEP)))
for scenario in (GOOD, BAD):
    scenario.module("legs").handles(STEP)(lambda _: None)
    scenario.module("user").does(lambda me: [me.command(STEP)])
"""


def tca_explore(folder: Path, text: str, *options: str) -> Result:
    path = folder / "scenarios.py"
    path.write_text(text)
    return CliRunner().invoke(explore_file, [str(path), *options])


def test_command_explores_each_scenario(tmp_path: Path) -> None:
    result = tca_explore(tmp_path, SCENARIO)
    assert result.exit_code == 1
    assert result.stdout.startswith(
        "good one: good, 3 states, at most 2 actions a run\nbad one: NOT never step handled"
    )
    assert "  1. user sends command step\n" in result.stdout


def test_exit_code_is_zero_only_for_good_scenarios(tmp_path: Path) -> None:
    assert tca_explore(tmp_path, SCENARIO.replace("never(handled(STEP))", "")).exit_code == 0
    limited = tca_explore(tmp_path, SCENARIO, "--limit", "1")
    assert limited.exit_code == 1
    assert "not known" in limited.stdout


def test_unexplorable_scenario_does_not_stop_the_others(tmp_path: Path) -> None:
    result = tca_explore(
        tmp_path, SCENARIO.replace("never(handled(STEP))", "never(handled(Command('stop')))")
    )
    assert result.exit_code == 2
    assert "scenario 'bad one': it can't be judged" in result.stderr
    assert "good one: good" in result.stdout


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = 1", "has no scenario: create a tca_tools.explore.Scenario at its top level"),
        ("\na = b", "scenarios.py, line 2: can't be run: NameError: name 'b' is not defined"),
        ("a = (", "can't be run: SyntaxError"),
        (
            SCENARIO.replace("me.command(STEP)", "me.walk()"),
            "scenario 'good one': the script of user",
        ),
    ],
)
def test_unexplorable_file_exits_with_usage_error(tmp_path: Path, text: str, words: str) -> None:
    result = tca_explore(tmp_path, text)
    assert result.exit_code == 2
    assert words in result.stderr


def test_limit_report_names_parts_that_multiply_states(tmp_path: Path) -> None:
    """The report names the parts that multiply states, the most frequent part first. Here an
    irrelevant clock comes first.
    """
    text = """
from tca_tools.explore import Scenario, never_stuck
from tca_module import Command, PollingMonitor, Query
LOW, MOVE, WAIT = Query("low", reply=bool), Command("move"), Command("wait")
BATTERY = PollingMonitor("battery", condition=LOW)
BUSY = Scenario("busy", never_stuck())
BUSY.module("eyes").handles(LOW)(lambda _: False)
BUSY.module("legs", may_be_lost=1).handles(MOVE)(lambda _: None)
boss = BUSY.module("boss")
@boss.handles(WAIT)
def wait(task):
    task.monitor(BATTERY, period=1.0, duration=30.0)
    task.command(MOVE).wait()
boss.does(lambda me: [me.command(WAIT, deadline=20.0)])
"""
    result = tca_explore(tmp_path, text, "--limit", "60")
    assert result.exit_code == 1
    first, second = result.stdout.splitlines()
    assert first.startswith("busy: not known, nothing wrong in the first 6")
    assert second.startswith("  commonest alternatives: ")
    assert second.endswith("; leave out those that you need least")
    for words in ("the period of monitor 'battery' (", "the loss of legs (", "steps of "):
        assert words in second


def test_scenario_file_imports_modules_beside_it(tmp_path: Path) -> None:
    """As with ``python scenarios.py``, imports work from any working directory."""
    (tmp_path / "stepping.py").write_text(
        "from tca_wire.messages.declarations import Command\nSTEP = Command('step')\n"
    )
    text = SCENARIO.replace('STEP = Command("step")', "from stepping import STEP").replace(
        "never(handled(STEP))", ""
    )
    path = tmp_path / "scenarios.py"
    path.write_text(text)
    code = "from tca_tools.explore.command import explore_file; explore_file()"
    ran = subprocess.run(
        [sys.executable, "-c", code, path], capture_output=True, text=True, timeout=60, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert "good one: good, 3 states" in ran.stdout


def test_documented_counterexample_is_real_output() -> None:
    page = (ROOT / "docs/tools/explorer.md").read_text()
    assert '--8<-- "07_explore.py"' in page
    assert '--8<-- "printed/07_explore.txt"' in page
    result = CliRunner().invoke(explore_file, [str(ROOT / "examples/07_explore.py")])
    assert result.stdout == (ROOT / "examples/printed/07_explore.txt").read_text()


def test_progress_is_shown_on_terminal_only(tmp_path: Path) -> None:
    """Progress is one terminal line, which is erased at the end. Standard output has none of it."""
    path = tmp_path / "scenarios.py"
    path.write_text(
        SCENARIO + "for name in 'abc':\n    GOOD.module(name).does(lambda me: [me.command(STEP)])"
    )
    ours, theirs = os.openpty()
    code = "from tca_tools.explore.command import explore_file; explore_file()"
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        stdout=subprocess.PIPE,
        stderr=theirs,
        timeout=60,
        check=False,
    )
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    os.close(theirs)
    assert "states, " in done.stdout.decode()
    assert re.search(r"[\d,]+ states, [\d,]+ not yet explored further", shown)
    assert shown.endswith("\r\x1b[K")


def test_missing_scenario_file_exits_with_usage_error() -> None:
    assert CliRunner().invoke(explore_file, ["nowhere.py"]).exit_code == 2
