"""The command line's hand on a running central: tasks, messages and variables, as people and scripts use it."""

import json
import re
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from integration.programs import central

from tca_module import (
    Broadcast,
    Client,
    Command,
    Condition,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    Module,
    MultiQuery,
    Outcome,
    PollingMonitor,
    Query,
    Refused,
    Task,
    Variable,
    connect,
)
from tca_module.commands import attached, modules, status
from tca_module.message_commands import get_variable, query, send, set_variable
from tca_module.task_commands import detach, kill, raise_failure, resume, suspend, unlock
from tca_tools.logs import open_log
from tca_wire import facts

pytestmark = pytest.mark.slow

SOON = 20.0


@dataclass
class Pose:
    x: float
    y: float = 0.0


@dataclass
class Move:
    leg: int
    to: Pose


WALK, MOVE, LATER = Goal("walk", int), Command("move", Move, result=Pose), Command("later")
SAY, TICK = Inform("say", str), Broadcast("tick")
WHERE, HEALTH, SILENT = Query("where", Pose, reply=Pose), MultiQuery("health", reply=float), Query("silent", reply=int)
MODE, POSE = Variable("mode", str), Variable("pose", Pose)
SAY_MOVE = Inform("say move", Move)
FIX, LOOK = ExceptionHandler("fix"), PollingMonitor("look", condition=Query("is it", reply=bool), action=LATER)
FELL = Failure("fell", int)


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    with central(tmp_path, "--quiet") as daemon:
        yield daemon.address


@pytest.fixture
def user(address: str) -> Iterator[Client]:
    with connect("user", address) as client:
        client.wait_until_handled(timeout=SOON)
        yield client


@pytest.fixture
def robot(address: str) -> Iterator[list[str]]:
    """A robot; what it heard."""
    robot, other, heard = Module("robot", address), Module("other", address), list[str]()

    @robot.handles(WALK)
    def walk(task: Task, steps: int) -> None:
        if steps < 0:
            raise FELL(steps, "too\nsteep\x1b[31m")
        for _ in range(steps):
            task.command(LATER)

    robot.handles(MOVE)(lambda _, move: move.to)
    robot.handles(WHERE)(lambda _, pose: Pose(pose.x + 1.0, pose.y))
    robot.handles(SAY)(lambda _, text: heard.append(text))
    robot.handles(TICK)(lambda _: heard.append("tick"))
    robot.handles(HEALTH)(lambda _: 0.5)
    other.handles(HEALTH)(lambda _: 0.5)
    with robot.running(), other.running():
        yield heard


@pytest.fixture(autouse=True)
def _find_central(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TCA_CENTRAL", address)


def tca(command: click.Command, *words: str, given: str = "") -> tuple[int, str, str]:
    """Exit code, output and errors."""
    result = CliRunner().invoke(command, words, input=given)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr.removeprefix("Usage:").rpartition("Error: ")[2]


# --- send ------------------------------------------------------------------------------------------------------------


def test_a_goal_is_sent_and_its_number_told(robot: list[str], user: Client) -> None:
    code, text, _ = tca(send, "walk", "1")
    task = user.tasks("walk")[0]
    assert (code, text) == (0, f"task {task.id} 'walk'\n")
    assert tca(send, "walk", "1", "--json")[:2] == (0, f'{{\n "task": {user.tasks(WALK)[1].id}\n}}\n')


def test_the_end_of_a_task_is_waited_for(robot: list[str]) -> None:
    code, text, _ = tca(send, "move", "leg=1", "to.x=2", "to.y=0", "--wait")
    assert code == 0
    assert text.splitlines()[1] == 'done: {"x": 2.0, "y": 0.0}'
    code, text, _ = tca(send, "move", '{"leg": 1, "to": {"x": 2, "y": 3}}', "--wait", "--json")
    told = json.loads(text)
    assert (code, told["outcome"], told["result"]) == (0, "done", {"x": 2.0, "y": 3.0})
    assert tca(send, "move", "-", "--wait", given='{"leg": 1, "to": {"x": 1}}')[0] == 0
    assert tca(send, "walk", "0", "--wait")[1].endswith("'walk'\ndone\n")


def test_a_task_that_fails_or_is_killed_is_a_no(robot: list[str], user: Client) -> None:
    code, text, error = tca(send, "walk", "--wait", "--", "-1")
    assert (code, error) == (1, f"{text.strip()} failed: fell: too\n")
    code, text, _ = tca(send, "walk", "--wait", "--json", "--", "-1")
    told = json.loads(text)
    assert (code, told["outcome"], told["failure"], told["data"]) == (1, "failed", "fell", -1)
    killed: list[tuple[int, str, str]] = []
    waiting = threading.Thread(target=lambda: killed.append(tca(send, "later", "--wait")))
    user.execute_if_handled(LATER)
    waiting.start()
    while not (found := user.tasks("later")):
        user.modules()
    found[0].kill("enough")
    waiting.join(SOON)
    assert killed[0][0] == 1
    assert killed[0][2].endswith(f"task {found[0].id} 'later' was killed: enough\n")


def test_nobody_waits_longer_than_he_says(robot: list[str], user: Client) -> None:
    code, text, error = tca(send, "walk", "1", "--timeout", "0.1")
    task = user.tasks("walk")[0].id
    assert (code, text) == (1, f"task {task} 'walk'\n")
    assert error == f"task {task} 'walk' has not ended within 0.1 s, and goes on: 'tca kill {task}' ends it\n"


def test_statements_have_arrived_when_the_command_ends(robot: list[str], user: Client) -> None:
    for word, heard in (("hello", "hello"), ("5", "5"), ("a=b", "a=b"), ('"quoted"', "quoted"), ("null", "null")):
        assert tca(send, "say", word) == (0, "", "")
        user.query(WHERE, Pose(0.0), timeout=SOON)  # the robot is one thread: it has handled what came before
        assert robot.pop() == heard
    assert tca(send, "tick") == (0, "", "")


def test_who_sends_what_nobody_handles_is_told(user: Client) -> None:
    user.execute_if_handled(LATER)
    user.execute_if_handled(TICK)
    code, _, error = tca(send, "later")
    assert (code, error) == (0, "nobody handles command 'later' now: it waits until a module does\n")
    assert tca(send, "tick")[2] == "nobody handles broadcast 'tick' now: it reaches nobody\n"


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["walkk", "3"], 1, "nobody has declared a message 'walkk': did you mean 'walk'?"),
        (["xyz"], 1, "nobody has declared a message 'xyz': see 'tca messages', and start who declares it"),
        (["walk"], 2, "goal 'walk' wants data (integer), and none were given"),
        (["walk", "five"], 2, "goal 'walk' wants data of type integer: the data must be a whole number, and \"five\" is not"),
        (["walk", "3", "4"], 2, "goal 'walk' takes one value (integer), and 2 were given"),
        (["move", "leg=1"], 2, "command 'move' wants data of type Move: field 'to' is missing: it must be an object with x, y"),
        (["move", "leg=1", "to.z=1", "to.x=1"], 2, "command 'move' wants data of type Move: field 'to.z' is unknown: the fields are x, y"),
        (["move", "leg=1", "leg=2"], 2, "field 'leg' is given twice: give it once"),
        (["move", "to={}", "to.x=2"], 2, "field 'to.x' is given, and so is 'to' as a whole: give one of them"),
        (["move", "leg=1", "x"], 2, "'x' is no field of command 'move': write key=value"),
        (["move", "-"], 2, "the standard input holds no JSON: Expecting value: line 1 column 1 (char 0)"),
        (["tick", "5"], 2, "broadcast 'tick' takes no data, and '5' was given"),
        (["tick", "--wait"], 2, "broadcast 'tick' has no end to wait for: leave --wait and --timeout out"),
        (["mode", "x"], 2, "variable 'mode' is not sent: set it with 'tca set'"),
        (["fix", "1"], 2, "exception handler 'fix' is not sent: raise its failure with 'tca raise'"),
        (["look"], 2, "'look' is a polling monitor: declare it in Python to have it watch"),
        (["say", "\udcff"], 2, "inform 'say' wants data of type string: 'utf-8' codec can't encode character '\\udcff' in position 0: surrogates not allowed"),
    ],
)  # fmt: skip
def test_what_cannot_be_sent(robot: list[str], user: Client, words: list[str], code: int, error: str) -> None:
    user.on_failure(FELL, FIX)
    user.get_variable(MODE, None)
    user.monitor(LOOK, period=60).kill()
    before = user.status()["newest id"]
    assert tca(send, *words) == (code, "", error + "\n")
    assert user.status()["newest id"] == before


# --- query -----------------------------------------------------------------------------------------------------------


def test_a_reply_is_printed(robot: list[str]) -> None:
    for command in (query, send):
        assert tca(command, "where", "x=1", "y=2.5") == (0, '{"x": 2.0, "y": 2.5}\n', "")
    code, text, _ = tca(query, "where", "x=1", "--json")
    assert (code, json.loads(text)) == (0, {"x": 2.0, "y": 0.0})


def test_each_reply_of_many_is_printed(robot: list[str]) -> None:
    assert tca(query, "health") == (0, "0.5\n0.5\n", "")
    assert tca(query, "health", "--maximum", "1") == (0, "0.5\n", "")
    assert json.loads(tca(query, "health", "--json")[1]) == [0.5, 0.5]


def test_questions_without_an_answer(robot: list[str], user: Client) -> None:
    for message in (SILENT, MultiQuery("nobody", reply=int)):
        user.execute_if_handled(message)
    code, text, error = tca(query, "silent", "--timeout", "0.1")
    assert (code, text) == (1, "")
    assert error.endswith("query 'silent' was not answered within 0.1 s: see 'tca messages', or give --timeout\n")
    assert tca(query, "nobody")[0] == 1
    assert tca(query, "walk", "1") == (2, "", "goal 'walk' is no query: send it with 'tca send'\n")
    assert tca(query, "where", "x=1", "--maximum", "2")[0] == 2


# --- variables -------------------------------------------------------------------------------------------------------


def test_variables_are_set_and_read(user: Client) -> None:
    for variable in (MODE, POSE):
        user.get_variable(variable, None)
    assert tca(get_variable, "mode") == (
        1, "", "variable 'mode' was never set: 'tca set' does, or who should set it does not run\n"
    )  # fmt: skip
    assert tca(set_variable, "mode", "walking") == (0, "", "")
    assert user.get_variable(MODE) == "walking"
    assert tca(get_variable, "mode") == (0, "walking\n", "")
    assert tca(set_variable, "pose", "x=1") == (0, "", "")
    assert user.get_variable(POSE) == Pose(1.0, 0.0)
    assert tca(get_variable, "pose", "--json") == (0, '{\n "x": 1.0\n}\n', "")
    assert tca(set_variable, "pose", "z=1")[0] == 2
    assert tca(get_variable, "walk")[:2] == (1, "")


# --- tasks -----------------------------------------------------------------------------------------------------------


def test_a_task_is_killed_by_its_number_or_its_name(robot: list[str], user: Client) -> None:
    one, other = user.goal(WALK, 1), user.goal(WALK, 2)
    other.wait_for(other.handling.end, SOON)
    code, _, error = tca(kill, "walk")
    assert (code, error) == (1, f"2 living tasks are called 'walk': give the number of one, {one.id}, {other.id}\n")
    assert tca(kill, str(one.id), "--why", "enough") == (0, f"task {one.id} 'walk': killed\n", "")
    assert tca(kill, "walk", "--descendants") == (0, f"all under task {other.id} 'walk': killed\n", "")
    assert one.wait(SOON) is Outcome.KILLED
    assert other.wait(SOON) is Outcome.DONE
    assert tca(kill, str(one.id)) == (1, "", f"task {one.id} has ended: 'tca tree' shows how\n")
    assert tca(kill, "walk") == (1, "", "no living task is called 'walk': 'tca tree' shows them all\n")


def test_kills_with_a_delay_and_of_siblings(robot: list[str], user: Client) -> None:
    one, other = user.goal(WALK, 1), user.goal(WALK, 1)
    assert tca(kill, str(one.id), "--siblings") == (0, f"the siblings of task {one.id} 'walk': killed\n", "")
    assert other.wait(SOON) is Outcome.KILLED
    assert tca(kill, "walk", "--in", "0.05") == (0, f"task {one.id} 'walk': to be killed in 0.05 s\n", "")
    assert one.wait(SOON) is Outcome.KILLED


def test_a_task_is_suspended_and_resumed(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    for command, state in (
        (suspend, "suspended"), (suspend, "suspended already"), (resume, "resumed"), (resume, "not suspended")
    ):  # fmt: skip
        assert tca(command, "walk") == (0, f"task {walk.id} 'walk': {state}\n", "")


def test_the_status_names_what_is_suspended(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    walk.wait_for(walk.handling.end, SOON)
    walk.suspend()
    (told,) = [one for one in json.loads(tca(status, "--json")[1])["waiting"] if "suspended" in one["for"]]
    assert told["what"] == f"task {walk.id} 'walk'"
    assert re.fullmatch(rf"'tca resume {walk.id}': suspended by user for \d+\.\d s", told["for"])
    walk.resume()
    assert "suspended" not in tca(status)[1]
    tca(suspend, "walk")
    assert re.search(r"suspended by the command 'tca suspend' for \d+\.\d s", tca(status)[1])


def test_exception_handlers_and_wiretaps_are_listed(robot: list[str], user: Client) -> None:
    assert tca(attached) == (0, "no exception handlers, wiretaps or monitors\n", "")
    walk = user.goal(WALK, 1)
    fell = user.on_failure(FELL, FIX, of=WALK, maximum=2)
    user.on_failure(None, FIX)
    walk.on_failure(FELL, FIX)
    with connect("other script") as other:
        other.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
        user.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
        user.tap(Condition.WHILE_HANDLING, walk, LOOK, period=1.0)
        look = other.under(walk).monitor(LOOK, period=9.0)
        code, text, _ = tca(attached)
        told = json.loads(tca(attached, "--json")[1])
    fields = [re.split(r" {2,}", line.strip()) for line in text.splitlines()]
    assert (code, fields[1][0]) == (0, str(fell.id))
    assert [words[1:] for words in fields[1:4]] == [
        ["fell", "'walk'", "fix", "2", "user", "nobody"],
        ["any failure", "the root", "fix", "user", "nobody"],
        ["fell", f"task {walk.id} 'walk'", "fix", "user", "nobody"],
    ]
    assert [words[1:] for words in fields[6:8]] == [
        ["before handling", "'move'", "later", "other script, user", "nobody"],
        ["while handling", f"task {walk.id} 'walk'", "look", "user", "central"],
    ]
    assert fields[9:] == [
        ["number", "monitor", "under", "sent by"],
        [str(look.id), "look", f"task {walk.id} 'walk'", "other script"],
    ]
    first = {"id": fell.id, "failure": "fell", "handler": "fix", "task": 0, "message": "walk", "maximum": 2}
    assert told["exception_handlers"][0] == {**first, "modules": ["user"], "gone": [], "handled_by": []}
    assert [one["task"] for one in told["wiretaps"]] == [0, walk.id]
    text = tca(attached)[1]
    assert "other script (has left), user" in text
    assert text.count("(has left)") == 2
    fell.remove()
    left = user.status("attached")
    assert len(left["exception_handlers"]) == 2
    assert left["wiretaps"][0]["modules"] == ["other script", "user"]  # also when one of them is gone


def test_what_outlives_its_module_is_detached(robot: list[str], user: Client, tmp_path: Path) -> None:
    walk = user.goal(WALK, 1)
    walk.wait_for(walk.handling.end, SOON)
    with connect("panel") as panel:
        of_all, of_one = panel.on_failure(FELL, FIX, of=WALK), panel.on_failure(FELL, FIX, of=walk)
        check = panel.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
        watched = panel.tap(Condition.WHILE_ACHIEVING, WALK, LOOK, period=9.0)
        look = panel.under(walk).monitor(LOOK, period=9.0)
    user.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
    both = f"exception handler {of_all.id} 'fix' for failure 'fell' of 'walk'; exception handler {of_one.id} 'fix' for \
failure 'fell' of task {walk.id} 'walk'"
    assert tca(detach, "fix") == (
        1, "", f"2 that are attached are called 'fix': give the number of one, {both}: see 'tca attached'\n"
    )  # fmt: skip
    assert tca(detach, str(of_all.id)) == (0, both.split("; ", maxsplit=1)[0] + ": detached\n", "")
    assert tca(detach, "fix") == (0, both.split("; ", maxsplit=1)[1] + ": detached\n", "")
    assert tca(detach, "say move")[:2] == (
        0, f"wiretap {check.id} 'before handling' of 'move' with listener 'say move': detached\n"
    )  # fmt: skip
    assert tca(detach, str(look.id))[:2] == (0, f"monitor {look.id} 'look' under task {walk.id} 'walk': detached\n")
    there = f"there are wiretap {watched.id} 'while achieving' of 'walk' with listener 'look': see 'tca attached'\n"
    for what, why in (
        (str(check.id), f"{check.id} is not attached, or not any more"),
        ("9999", "nothing has had the number 9999 yet"),
        (str(walk.id), f"task {walk.id} 'walk' is not attached: 'tca kill {walk.id}' ends it"),
        ("fxi", "nothing that is attached is called 'fxi'"),
        ("0", "0 is not attached, or not any more"),
    ):
        assert tca(detach, what) == (1, "", f"{why}; {there}")
    assert user.detach(watched.id)
    assert not user.detach(watched.id)
    assert tca(detach, "look") == (1, "", "nothing that is attached is called 'look'; nothing at all is attached\n")
    with pytest.raises(Refused, match="is a goal, which is not attached: kill it to end it"):
        user.detach(walk.id)
    with pytest.raises(Refused, match="there is no exception handler or wiretap 9999"):
        user.detach(9999)
    gone = [fact for entry in open_log(tmp_path / "journal") for fact in entry.facts if isinstance(fact, facts.Removed)]
    numbers = [of_all.id, of_one.id, check.id, watched.id]
    assert [(fact.id, fact.by) for fact in gone] == list(zip(numbers, ["tca detach"] * 3 + ["user"], strict=True))


def test_a_resource_is_unlocked(robot: list[str], user: Client) -> None:
    user.lock("other")
    code, shown, _ = tca(modules)
    assert (code, "locked by user" in shown) == (0, True)
    with connect("waiting") as waiting:
        with pytest.raises(Exception, match="was locked by module 'user'"):
            waiting.lock("other", timeout=0)
        assert tca(unlock, "other") == (0, "resource 'other': free again\n", "")
        assert tca(unlock, "other", "--module", "other") == (0, "resource 'other': nobody had it\n", "")
        waiting.lock("other", timeout=0)
    assert tca(unlock, "arm") == (
        1,
        "",
        "unlocking resource 'arm' was refused: no module has a resource 'arm': see 'tca modules'\n",
    )


def test_a_failure_is_raised_on_a_task(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    told = tca(raise_failure, "walk", "fell", "it slipped", "--data", "7")
    assert told == (0, f"task {walk.id} 'walk': failure 'fell' was raised\n", "")
    with pytest.raises(Exception, match="fell: it slipped") as failed:
        walk.result(SOON)
    assert failed.value.data_as(FELL) == 7  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("task", "code", "error"),
    [
        ("0", 1, "task 0 is the root, which never ends: give the number of a task, 'tca tree' shows them all"),
        ("999", 1, "there is no task 999: 'tca tree' shows them all"),
        ("9" * 30, 1, f"there is no task {(1 << 63) - 1}: 'tca tree' shows them all"),
        ("nobody", 1, "no living task is called 'nobody': 'tca tree' shows them all"),
        ("", 2, "no task is named: give the number of a task, or its message's name"),
        ("\udcff", 2, "'\\udcff' is no text that can be sent"),
    ],
)
def test_tasks_that_are_none(task: str, code: int, error: str) -> None:
    for command, words in ((kill, ()), (suspend, ()), (resume, ()), (raise_failure, ("fell",))):
        assert tca(command, task, *words) == (code, "", error + "\n")


def test_nonsense_is_refused(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    assert tca(kill, "walk", "--in", "1e300")[0] == 2
    assert tca(kill, "walk", "--in", "-1")[0] == 2
    assert "is no number of seconds" in tca(kill, "walk", "--in", "nan")[2]
    assert "one after the other" in tca(kill, "walk", "--siblings", "--descendants")[2]
    assert "is no number of seconds" in tca(query, "where", "x=1", "--timeout", "nan")[2]
    assert tca(raise_failure, "walk", "a\nb")[0] == 2
    assert walk.info() is not None


def test_without_central_each_says_so_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nowhere = f"ipc://{tmp_path}/nowhere.sock"
    monkeypatch.setenv("TCA_CENTRAL", nowhere)
    monkeypatch.setattr("tca_module.command_parts._PATIENCE", 0.2)
    advice = "start it with 'tca central', or set $TCA_CENTRAL to where it listens\n"
    for command in (send, query, get_variable, set_variable, kill, suspend, resume):
        assert tca(command, "x") == (1, "", f"central at {nowhere} does not answer: {advice}")
