"""Every example runs, is short, and prints what it says."""

import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import RealCentral

pytestmark = pytest.mark.slow
EXAMPLES = Path(__file__).parents[2] / "examples"

HITS = "  at 0.1: collision\n  at 0.2: collision\n  at 0.3: collision\n"
RETRY_LADDER = f"step to foothold 1\n{HITS}step to foothold 2\n{HITS}given up: terrain collision\n"
PRINTED = {
    "01_fetch": "drive kitchen\ngrasp cup\ndrive home\ndrive kitchen\ngrasp piano\nfetch {5} failed: too heavy: in task 7 'grasp'\n",
    "02_questions": "height: 0.5\nheights: [0.0, 0.1, 0.2]\nlowest battery: 0.4\n",
    "03_plan_ahead": "plan row 0\n",
    "04_constraints": "boil water\nlay table\npour\n",
    "05_failure": "lift 0\nstep 0\nlift 1\nfailed: ",
    "06_testing_without_central": "passed\n",
    "07_explore": "a careful robot: good, ",
    "08_recovery": "lift to 0.2: hit a rock at 0.3\nlift to 0.4: clear\ndone\n",
    "09_monitors_and_taps": "checked 0.2\nmoved 0.2\nchecked 0.4\nmoved 0.4\n",
    "10_cups": "fetch the blue cup\nfetch the red cup\nthe blue cup is gone: given up\nfetched the red cup\n",
    "11_retry_ladder": RETRY_LADDER,
    "12_kill_and_leave_safe": "drilling\ntold to stop, stopped\nretracted\ndriving on\ndigging was killed\n",
    "13_suspend_and_resume": "step 1, suspended meanwhile\nthe second is held\nstep 2\nstep 3\nthe walk is done\n",
    "14_deadlines_and_delays": "charged in time\nflashed in time\ntimeout end achieving not reached within 0.2 s\n",
    "15_what_waits": "a picture\na warning\npose 99\nthe weather\n",
    "16_asking_many": "the first bid: [3]\nall in time: [3]\nbid: 3\nbid: 6\n",
    "17_only_if_handled": "None None\nblinking green\ndone dry\n",
    "18_what_was_done_already": "stowed the cup\nstowed the plate\ntook out the plate\ntook out the cup\npacking was killed\n",
    "19_explore_recovery": "over a stone: good, ",
    "20_variables": "mode before: none\nmode when it stopped: walking\nposition: 100.0\nshown all 101 positions: False\n",
    "21_start_up_order": "asked too early: None\n",
    "34_locks": "scan\nscanned\nmove 1\n",
    "35_deadlock": "eyes: where {1} in map waits for the reply to look {2};\n",
    "36_watch_a_running_task": "walking\nthe battery is low\nstopped\nthe walk was killed, and its monitor killed\n",
    "37_follow_and_update": "looks at 10.0\nlooks at 30.0\nrejected: it turns by 90 degrees at most\nthe shutter is closed\n"
    "killed cancelled seen enough (by user)\n",
    "30_async_handlers": "heights: [0.0, 0.5, 1.0] ",
    "31_reply_later": "moved to 0.5\nmotor stalled 2.0\n",
    "32_timer_and_device": "battery at 100\nbattery at 90\nbattery at 80\ntime to go home\n",
    "40_task_server": "20 degrees\nswitched off\nheated to 26 degrees\nswitched off\n",
    "41_mission": "at 2 m\nat 6 m\nat 1 m\nit rains\n",
    "46_curious_robot_asks": (
        "the first question: accepted\nthe second question: rejected, dialog is busy\nthe thing is a banana\n"
    ),
    "47_curious_robot_grasps": "moving to 10\nmoving to 7\n99 is out of reach\ngrasped at 7\n",
    "48_curious_robot_looks": (
        "rejected: nobody is there\nlooks at a face at 0, 1.7\nit is a banana\nlooks at a thing at 0.4, 0.1\n"
    ),
    "45_state_machine": "drive to the gate\ndrive to the pond\ndrive to the gate\nan intruder: lights on\n",
    "52_three_programs": "table is laid\nwater is hot\nserved\n",
    "50_preview": "arm begins to move to box B\narm stops on its way to box B\nbase is at B\narm begins to move to box C\n"
    "arm is at box C\nbase is at C\ndropped\nCoordinationEnd(state='delivered', transitions=4, kept=1, wasted=1)\n",
    "51_activities": (
        "one_for_all: not schedulable\n"
        "  all, every 2 ms: no bound\n"
        "automatic: schedulable\n"
        "  processor 1, every 2 ms: within 1.9 ms\n"
        "  processor 2, every 20 ms: within 2.7 ms\n"
        "maps drawn: True - balanced more often: True\n"
        "processors: processor 1, processor 2, mapping\n"
    ),
    "33_direct": "directly\nhighest: 100.0\nthrough central\nasked for 7.0\ndirectly\n",
}
LATER = {
    "40_task_server": ["Heat {", "timeout: it ran for 0.1 s: heated to "],
    "05_failure": ["terrain collision", "leg 1 met a rock"],
    "07_explore": ["a hasty robot: NOT drive achieved before grasp begun"],
    "19_explore_recovery": ["out of a hole: NOT never lift leg failed with data=20"],
    "21_start_up_order": [
        "'where' is handled by 1\n", "'route' is handled by 1\n", "route: 3 by planner\n", "map left: it said goodbye\n",
    ],
    "30_async_handlers": ["\ncamera off\nwatch ended: seen enough (by eyes)\n"],
}  # fmt: skip
"""What comes after that."""


RUNNER = """
import gc, os, runpy, sys
import tca_explorer, tca_module.testing
gc.freeze()  # a child's collections copy no memory
for line in sys.stdin:
    path, address, output = line.split()
    if not (child := os.fork()):
        os.environ["TCA_CENTRAL"] = address
        for stream in (1, 2):
            os.dup2(os.open(f"{output}.{stream}", os.O_WRONLY | os.O_CREAT), stream)
        sys.path[0] = os.path.dirname(path)
        runpy.run_path(path, run_name="__main__")
        sys.exit()
    print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.fixture(scope="module")
def runner() -> Iterator["subprocess.Popen[str]"]:
    """Runs a program at a central, each time in a new process that has imported the libraries already."""
    command, environment = [sys.executable, "-c", RUNNER], {**os.environ, "PYTHONPATH": str(EXAMPLES.parent)}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1, env=environment
    ) as running:  # fmt: skip
        yield running


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example(path: Path, tmp_path: Path, runner: "subprocess.Popen[str]") -> None:
    assert len(path.read_text().splitlines()) <= 60
    assert runner.stdin
    assert runner.stdout
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        runner.stdin.write(f"{path} {daemon.address} {tmp_path}/said\n")
        too_late = threading.Timer(60, runner.kill)
        too_late.start()
        code = runner.stdout.readline()
        too_late.cancel()
    printed = (tmp_path / "said.1").read_text()
    assert code == "0\n", (tmp_path / "said.2").read_text()
    assert printed.startswith(PRINTED[path.stem])
    if path.stem == "03_plan_ahead":
        diary = printed.splitlines()
        assert [line for line in diary if "plan" in line] == [f"plan row {row}" for row in range(4)]
        assert [line for line in diary if "mow" in line] == [f"mow row {row}" for row in range(4)]
        for row in range(3):
            assert diary.index(f"plan row {row + 1}") < diary.index(f"mow row {row}")
        for row in range(2):
            assert diary.index(f"mow row {row}") < diary.index(f"plan row {row + 2}")
    assert not [words for words in LATER.get(path.stem, ()) if words not in printed]


def test_each_example_is_shown_in_the_docs() -> None:
    pages = [EXAMPLES.parent / "README.md", *(EXAMPLES.parent / "docs").glob("*.md")]
    shown = {number for page in pages for number in re.findall(r"(?:Example |examples/)(\d\d)", page.read_text())}
    assert shown == {path.name[:2] for path in EXAMPLES.glob("*.py")}


def test_the_readme_quotes_the_first_example() -> None:
    code = (EXAMPLES / "01_fetch.py").read_text().partition('"""\n\n')[2]
    readme = (EXAMPLES.parent / "README.md").read_text()
    assert readme.partition("```python\n")[2].partition("```")[0] == code
    assert readme.partition(code)[2].split("```\n")[2] == PRINTED["01_fetch"]
