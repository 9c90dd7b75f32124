"""Code in README and docs/ is correct. Quotes match their examples, and all other code passes mypy.

mypy sees each block after the names that its page assumes. It finds wrong calls, options and names,
and data of wrong types.
"""

import ast
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = {path.stem: path.read_text() for path in sorted((ROOT / "examples").glob("*.py"))}

OTHER_WORDS = (
    "tca ",
    "central: ",
    "robot$ ",
    "pip install ",
    "$ ",
    "python -m ",
    "traverse path",
    "where {1} in map",
    "00 00 ",
    "[Unit]",
    "[[allow]]",
)
"""First words of blocks other than Python: shell commands, output, packets, and systemd units."""

QUOTES = {
    "pending = [asker.query_send": "02_questions",
    'print("the first bid:"': "16_asking_many",
    'blinking = user.execute_if_handled(BLINK, "green")': "17_only_if_handled",
    "with task.sequence(plan_ahead=1):": "03_plan_ahead",
    "charge = task.command(CHARGE, delay=0.2)": "14_deadlines_and_delays",
    "@planner.handles(DIG)": "12_kill_and_leave_safe",
    "user.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)": "09_monitors_and_taps",
    "task.monitor(CUP_GONE": "10_cups",
    "monitor = watcher.under": "36_watch_a_running_task",
    'from tca_behaviours.missions.charts import Sequence\n\nwith Sequence("patrol")': "45_state_machine",
    "from tca_behaviours.missions import (\n    Environment,\n    Mission,": "40_task_server",
    'with Coordination("deliver", facts={"base": "A", "arm": "home"})': "50_preview",
    '@robot.handles(MOVE_BASE, resource="base")': "50_preview",
    "coordinator = Coordinator(deliver, policy=": "50_preview",
    "coordinator = Coordinator(make_tea, policy=": "52_three_programs",
    "def make_request() -> None:": "52_three_programs",
    'WATCH = Command("watch"': "37_follow_and_update",
    "watching = user.command(WATCH, 10.0)": "37_follow_and_update",
    'with (\n    TaskServer("cart", Cart(), tasks=[Drive, WaitForRain]': "41_mission",
    'with (\n    TaskServer("truck", Truck()': "42_three_servers",
    "walking.suspend()": "13_suspend_and_resume",
    "planner.on_failure(COLLISION, RAISE_LEG": "11_retry_ladder",
    "@expert.handles(GO_ROUND)": "11_retry_ladder",
    "task.command(STOW, thing, keep=True)": "18_kept_tasks",
    "@display.handles(POSE, pending=1)": "15_queueing",
    'with task.lock("controller"': "34_locks",
    'GRASP = Command("grasp"': "24_retry_policy",
    "user.on_failure(TIMEOUT, TAKE_STAIRS": "24_retry_policy",
    "@planner.handles(UNDO)": "56_undo",
    'pen_holder.resource("pen")': "25_mutex",
    "with (\n    LocalCentral(stepped=True) as central,": "06_testing_without_central",
    "class Robot(Component[list[str]])": "51_activities",
    'application = Application("balancing robot", [robot])': "51_activities",
}
"""First words of blocks that quote an example."""


PLAIN = """
import asyncio
from typing import Any
from tca_module import *
class Place: ...
class Image: ...
arm = driver = eyes = ground = safety = Module("any")
LOOK, SURVEY = Query("look", Place, reply=Image), Command("survey", list[Place])
HEIGHT, CONFIRM, TEMPERATURE = Query("a", Place, reply=float), Query("b", int, reply=bool), Query("c", reply=float)
BATTERY, COOL_DOWN, MOVE, STABILITY_CHECK = Inform("d", int), Command("e"), Command("f", float, result=float), Command("g")
GIVE_UP, MOVE_LEG, RAISE_LEG, TERRAIN_COLLISION = ExceptionHandler("k"), Command("h", int, result=int), ExceptionHandler("i"), Failure("j", float)
NOTE = Inform("l")
def parse(line: bytes) -> int: ...
def give_up() -> None: ...
class Cable:
    def read(self) -> bytes: ...
    def write(self, line: bytes) -> None: ...
    def fileno(self) -> int: ...
class Motor:
    def start(self, angle: float, on_stop: LaterReply[float]) -> None: ...
cable, motor, task = Cable(), Motor(), Task.__new__(Task)
http: Any = None
"""

AMBLER = """
from robots.ambler_sim.messages import *
from robots.ambler_sim.layers.stability import *
from robots.ambler_sim.recovery import *
from tca_module import Condition, Module
module = Module("any")
"""

EXPLORER = """
from tca_tools.explore import *
from tca_module import Command, Failure, Goal
from tca_wire.points import Moment
"""

MACHINES = """
from tca_behaviours.missions import Mission
from tca_behaviours.missions.charts import Concurrence, Sequence, StateMachine
patrol: StateMachine = Sequence("any")
sm = patrol
"""

SERVERS = """
from tca_behaviours.missions import *
from tca_module import *
from tca_module.testing import LocalCentral
PLACE = Inform("place", float)
class Measure(OnceTask[Environment]):
    def iterate(self) -> None: ...
class Heat(Measure): ...
class Park(Measure): ...
class Oven(Environment):
    door_is_open = False
task_period = 0.0
"""

LIFE_CYCLES = """
from tca_module import *
from tca_module.testing import LocalCentral
WATCH = Command("watch", float, progress=float)
camera = lamp = Module("any")
user = connect()
watching = user.command(WATCH, 0.0)
"""

ACTIVITIES = """
from dataclasses import dataclass
from typing import Any
from tca_behaviours.activities import *
from tca_behaviours.activities.components import Component
from tca_behaviours.activities.manager import *
from tca_module import *
application, user = Application("any"), connect()
joint: Any = None
"""

MISSIONS = """
from typing import Any
from tca_behaviours.missions import *
from tca_module import Timeout
cart: Any = None
make_server: Any = None
mission: Mission = Mission("cart")
"""

COORDINATION = """
from pathlib import Path
from tca_behaviours.coordination import *
from tca_module import Command, Variable
MOVE_BASE, BOX_B_FREE, base = Command("a", str), Variable("b", float), Agent("base")
"""

OFFICE = """
from robots.office_sim.layers.battery import CHARGE_LATER, NOT_CHARGED, RECHARGE, TRIES, WAIT, _interrupt
from robots.office_sim.layers.grasps import *
from robots.office_sim.layers.vanished_cups import CANCEL_GOAL, IS_GONE, PERIOD
from robots.office_sim.messages import *
from robots.office_sim.modules.task_manager import _cups_with_goals
from robots.office_sim.vocabulary import *
from tca_module import *
layer = manager = module = Module("any")
pace = 1.0
"""

NAMES = {
    "office": OFFICE,
    "life-cycles": LIFE_CYCLES,
    "ambler": AMBLER,
    "explorer": EXPLORER,
    "modules": PLAIN,
    "command-line": PLAIN,
    "preview-coordination": COORDINATION,
    "missions": MISSIONS,
    "activities": ACTIVITIES,
    "state-machines": MACHINES,
    "task-servers": SERVERS,
}
"""Code with the names that each page assumes."""


class Block:
    """A block of a page, as shown."""

    def __init__(self, page: Path, line: int, text: str, language: str) -> None:
        self.where = f"{page.name}:{line}"
        self.name = f"{page.stem.replace('-', '_')}_{line}"
        self.names = NAMES.get(page.stem, "")
        self.text = textwrap.dedent(text).strip("\n") + "\n"
        self.language = language

    @property
    def is_python(self) -> bool:
        return self.language == "python" or (
            not self.language and not self.text.startswith(OTHER_WORDS)
        )

    @property
    def is_quote(self) -> bool:
        return self.text.startswith(tuple(QUOTES))

    @property
    def lines(self) -> list[str]:
        """Return the lines of code of the block, without comments."""
        return [line for line in (without_comment(line) for line in self.text.splitlines()) if line]


def without_comment(line: str) -> str:
    """Return a line of code without its comment, and without a "..." for omitted code."""
    return re.sub(r"(^|  )#.*", "", line).strip().removesuffix(": ...").removesuffix(":")


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page, and those that are indented after an empty line."""
    for found in re.finditer(
        r"^```(?P<language>\w*)\n(?P<fenced>.*?)^```$|(?<=\n\n)(?P<indented>(?:    [^\n]*\n(?:\n(?=    ))*)+)",
        page.read_text(),
        re.MULTILINE | re.DOTALL,
    ):
        line = page.read_text()[: found.start()].count("\n") + 1
        if found["indented"] is not None:
            yield Block(page, line, found["indented"], "")
        else:
            yield Block(page, line, found["fenced"], found["language"] or "text")


BLOCKS = [block for page in PAGES for block in blocks(page)]
CODE = [block for block in BLOCKS if block.is_python]


@pytest.mark.parametrize("block", CODE, ids=[block.where for block in CODE])
def test_doc_block_is_python_or_listed(block: Block) -> None:
    ast.parse(block.text)


@pytest.mark.parametrize(("beginning", "example"), QUOTES.items(), ids=QUOTES.values())
def test_doc_quote_matches_its_example(beginning: str, example: str) -> None:
    (block,) = [block for block in CODE if block.text.startswith(beginning)]
    known = {without_comment(line) for line in EXAMPLES[example].splitlines()}
    assert [line for line in block.lines if line not in known] == []


@pytest.mark.slow
def test_doc_code_passes_mypy(tmp_path: Path) -> None:
    for block in CODE:
        if not block.is_quote:
            (tmp_path / f"{block.name}.py").write_text(block.names + block.text)
    options = [
        "--config-file",
        "setup.cfg",
        "--disable-error-code",
        "empty-body",
        "--no-error-summary",
    ]
    found = subprocess.run(
        [sys.executable, "-m", "mypy", *options, *map(str, sorted(tmp_path.glob("*.py")))],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.stdout + found.stderr == ""
