"""Typical mistakes of users. Each error names the call or message, the argument or name, and the
remedy. The snippets run with the names of this file, a central, a module and a client.
"""

import asyncio  # noqa: F401 - snippets use it, and names of missions
import gc
import re
import sys
import textwrap
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from module.real_central import RealCentral
from processes import run

import tca_module
from tca_behaviours.missions import Environment, OnceTask, TaskServer, parameter  # noqa: F401
from tca_behaviours.missions.charts import state  # noqa: F401
from tca_module import (
    Client,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    Module,
    Query,
    Task,
    TcaError,
    connect,
)
from tca_module.errors import BadData
from tca_module.testing import LocalCentral
from tca_wire.errors import BadFormat


@dataclass
class Place:
    x: float
    y: float


DRIVE, REST, LIFT = Command("drive", Place), Command("rest"), Command("lift", float)
FETCH, WHERE = Goal("fetch", str), Query("where", reply=float)
SLIPPED, AGAIN = Failure("slipped", float), ExceptionHandler("again")


class Mistake(NamedTuple):
    """A snippet with its error: the class, what it is about, which part is wrong, the remedy."""

    code: str
    error: str
    what: str
    which: str
    remedy: str


def later(code: str) -> str:
    """Return a snippet that runs in a coroutine, with an async client."""
    return f"""
        async def main():
            async with aconnect("later", central) as user:
                {code}
        asyncio.run(main())
    """


MISTAKES = {
    "handler with too few parameters": Mistake(
        "module.handles(DRIVE)(lambda place: None)",
        "MisuseError", "command 'drive'", "(place)", r"declare it with \(task, data: Place\)",
    ),
    "handler with a wrong annotation": Mistake(
        """
        def drive(task, place: str): ...
        module.handles(DRIVE)(drive)
        """,
        "MisuseError", "command 'drive'", "place: str", "annotate place with that",
    ),
    "handler with a wrong result annotation": Mistake(
        """
        def lift(task, kg: float) -> list[str] | None: ...
        module.handles(Command("weigh", float, result=float))(lift)
        """,
        "MisuseError", "command 'weigh'", "list[str] | None", "result of type float",
    ),
    "handler with swapped parameters": Mistake(
        "module.handles(LIFT)(lambda kg, task: None)",
        "MisuseError", "before the task", "'kg'", r"declare it with \(task, data\)",
    ),
    "handler that yields": Mistake(
        """
        def lift(task, kg):
            yield kg / 2
        module.handles(LIFT)(lift)
        """,
        "MisuseError", "command 'lift'", "'yield'", r"task\.report\(\)",
    ),
    "decorator without its message": Mistake(
        """
        @module.handles
        def drive(task, place): ...
        """,
        "MisuseError", "handles(MESSAGE)", "drive", r"write @module\.handles\(MESSAGE\)",
    ),
    "decorator without its period": Mistake(
        """
        @module.every
        def look(): ...
        """,
        "MisuseError", "every(PERIOD)", "look", r"write @module\.every\(PERIOD\)",
    ),
    "two handlers of one message": Mistake(
        """
        module.handles(REST)(lambda task: None)
        module.handles(REST)(lambda task: None)
        """,
        "MisuseError", "module 'm'", "'rest'", "leave one of the two out",
    ),
    "handler that is declared too late": Mistake(
        """
        with module.running():
            module.handles(REST)
        """,
        "MisuseError", "handles()", "module 'm'", r"before run\(\)",
    ),
    "name instead of a declaration": Mistake(
        "user.command('rest')",
        "MisuseError", "command()", "'rest'", r"give the declaration, such as Command\('rest'\)",
    ),
    "call for another class of message": Mistake(
        "user.goal(DRIVE, Place(1, 2))",
        "MisuseError", "goal()", "'drive'", r"use command\(\)",
    ),
    "unknown option": Mistake(
        "user.command(REST, timeout=5)",
        "MisuseError", "command 'rest'", "timeout", "the options are .*deadline",
    ),
    "data of a wrong type": Mistake(
        "user.command(DRIVE, Place(1, 'far'))",
        "BadData", "command 'drive'", "$.y", "wants data of type Place: Expected `float`",
    ),
    "unknown option of a query": Mistake(
        "user.query(WHERE, deadline=5)",
        "MisuseError", "query 'where'", "deadline", "the options are timeout, priority",
    ),
    "too many values": Mistake(
        "user.command(DRIVE, 1.0, 2.0)",
        "MisuseError", "command 'drive'", "got 2 values", "type Place",
    ),
    "data that is left out": Mistake(
        "user.command(DRIVE)",
        "BadData", "command 'drive'", "`None`", "wants data of type Place",
    ),
    "reply of a wrong type": Mistake(
        """
        def tell_place(task):
            return "here"
        module.handles(WHERE)(tell_place)
        with module.running():
            user.query(WHERE)
        """,
        "QueryFailed", "query 'where'", "tell_place", "must return float: Expected `float`",
    ),
    "type without a format": Mistake(
        "Command('look', [int])",
        "BadFormat", "command 'look'", "[<class 'int'>]", r"give a type, such as .*list\[int\]",
    ),
    "format that others declare otherwise": Mistake(
        """
        module.handles(LIFT)(lambda task, kg: None)
        with module.running():
            user.command(Command("lift", str), "cup")
        """,
        "FormatRefused", "command 'lift'", "string here, number there", "declare it once",
    ),
    "message before the start of its module": Mistake(
        "module.command(REST)",
        "MisuseError", "module 'm'", "does not run", "send within 'with module.running",
    ),
    "module that is started twice": Mistake(
        """
        with module.running(), module.running():
            pass
        """,
        "MisuseError", "module 'm'", "runs already", "leave its .* block",
    ),
    "client in another thread": Mistake(
        """
        import concurrent.futures as futures
        with futures.ThreadPoolExecutor() as pool:
            pool.submit(user.command, REST).result()
        """,
        "MisuseError", "client 'user'", "ThreadPoolExecutor", r"share it with connect",
    ),
    "task that is used after its handler": Mistake(
        """
        kept = []
        module.handles(REST)(kept.append)
        with module.running():
            user.command(REST).wait(timeout=10)
            kept[0].command(REST)
        """,
        "MisuseError", "rest {1}", "after its handler returned", "send before it returns",
    ),
    "client outside of its block": Mistake(
        """
        with connect("early", central) as early:
            pass
        early.command(REST)
        """,
        "MisuseError", "client", "is closed", "use it inside its 'with' block",
    ),
    "result of a message without a handler": Mistake(
        "user.query(WHERE, timeout=0)",
        "Timeout", "query 'where'", "no module handles it", "timeout=",
    ),
    "failure that is raised without its call": Mistake(
        """
        def rest(task):
            raise SLIPPED
        module.handles(REST)(rest)
        with module.running():
            user.command(REST).result(timeout=10)
        """,
        "TaskFailed", "rest {1}", "exceptions must derive", "call it: raise COLLISION",
    ),
    "await of a reply that is there": Mistake(
        """
        async def rest(task):
            await task.query(WHERE)
        module.handles(REST)(rest)
        module.handles(WHERE)(lambda task: 1.0)
        with module.running():
            user.command(REST).result(timeout=10)
        """,
        "TaskFailed", "rest {1}", "float can't be used in 'await'", r"await query_send\(\)",
    ),
    "failure without its data": Mistake(
        "SLIPPED()",
        "BadData", "failure 'slipped'", "`None`", "wants data of type float",
    ),
    "constraints that form a circle": Mistake(
        """
        first = user.command(REST, delay=100)
        second = user.command(REST, constraints=[first.achieving.end <= this.achieving.start])
        user.constrain(second.achieving.end <= first.achieving.start)
        """,
        "Refused", "constraint", "end achieving task 2 <= start achieving task 1", "leave out one",
    ),
    "order of two tasks": Mistake(
        "user.constrain(user.command(REST) < user.command(REST))",
        "MisuseError", "SentTask", "can't be compared", r"first\.achieving\.end <= second",
    ),
    "wait for one task instead of a list": Mistake(
        "wait_for_any(user.command(REST))",
        "MisuseError", "wait_for_any()", "rest {1}", "needs a list",
    ),
    "async client in a plain block": Mistake(
        """
        with aconnect("later", central):
            pass
        """,
        "MisuseError", "AsyncClient", "event loop", "write 'async with'",
    ),
    "async client that is awaited": Mistake(
        """
        async def main():
            await aconnect("later", central)
        asyncio.run(main())
        """,
        "MisuseError", "AsyncClient", "event loop", "write 'async with'",
    ),
    "blocking client in an async block": Mistake(
        later("async with connect('early', central): pass"),
        "MisuseError", "Client", "which blocks", r"write 'with'; aconnect\(\)",
    ),
    "async client that is opened twice": Mistake(
        later("await user.open()"),
        "MisuseError", "async client 'later'", "opened before", "make a new one",
    ),
    "lock of an async client in a plain block": Mistake(
        later("with user.lock('arm'): pass"),
        "MisuseError", "AsyncClaim", "event loop", "write 'async with'",
    ),
    "stream of an async client in a plain loop": Mistake(
        later("for step in (await user.command(REST)).progress(): pass"),
        "MisuseError", "AsyncStream", "event loop", "'async for'",
    ),
    "too many values for an async client": Mistake(
        later("await user.query(WHERE, 1.0, 2.0)"),
        "MisuseError", "query 'where'", "got 2 values", "give one",
    ),
    "order of two tasks of an async client": Mistake(
        later("(await user.command(REST)).achieving >= await user.command(REST)"),
        "MisuseError", "TaskInterval", "can't be compared", r"first\.achieving\.end <= second",
    ),
    "retry with an unnamed pause": Mistake(
        "Retry(3, 0.5)",
        "TypeError", "Retry()", "positional", r"write Retry\(attempts=3, \*, pause=",
    ),
    "outcome of a state without its name": Mistake(
        "state('found')",
        "MisuseError", "@state", "'found'", r"write @state\(outcomes=\[\.\.\.\]\)",
    ),
    "state without its outcomes": Mistake(
        """
        @state
        def search(data): ...
        """,
        "MisuseError", "@state", "search", r"write @state\(outcomes=\[\.\.\.\]\)",
    ),
    "task server with a class instead of a list": Mistake(
        "TaskServer('cart', Environment(), tasks=OnceTask)",
        "MisuseError", "server 'cart'", "tasks", r"a list of classes, such as \[Drive\]",
    ),
    "parameter without a type": Mistake(
        """
        class Drive(OnceTask):
            far = parameter(1.0)
            def iterate(self): ...
        TaskServer("cart", Environment(), tasks=[Drive])
        """,
        "BadFormat", "task Drive", "'far'", "write 'far: float = ",
    ),
    "command as an exception handler": Mistake(
        "user.on_failure(SLIPPED, REST)",
        "MisuseError", "on_failure()", "'rest'", "declare the message as one",
    ),
    "trouble outside of an exception handler": Mistake(
        """
        module.handles(REST)(lambda task: task.trouble.failing.retry())
        with module.running():
            user.command(REST).result(timeout=10)
        """,
        "TaskFailed", "task.trouble", "'rest'", r"name it in on_failure\(\)",
    ),
    "lock of a part that does not exist": Mistake(
        "user.lock('hand', module='arm')",
        "Refused", "lock", "'hand'", "see 'tca modules'",
    ),
    "address without a transport": Mistake(
        "connect('user', 'localhost:7400')",
        "MisuseError", "central's address", "'localhost:7400'", "must be .*'tcp://host:port'",
    ),
    "clock that runs by itself": Mistake(
        "LocalCentral().advance(1)",
        "MisuseError", "advance()", "stepped", r"LocalCentral\(stepped=True\)",
    ),
    "fake with a value of a wrong type": Mistake(
        "central.fake(WHERE, returns=[1.0, 'here'])",
        "BadData", "fake of query 'where'", "call 2", "give returns= a value of type float",
    ),
    "fake of a failure without its data": Mistake(
        "central.fake(REST, fails=SLIPPED)",
        "BadData", "fake of command 'rest'", "failure 'slipped'", "give the failure with its data",
    ),
    "module before those that it requires": Mistake(
        "central.start(Module('planner', requires=[DRIVE]))",
        "MisuseError", "module 'planner'", "'drive'", r"first, or fake\(\) the message",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES)
def test_mistake_is_told_with_its_remedy(mistake: Mistake, central: LocalCentral) -> None:
    names: dict[str, Any] = {**vars(tca_module), **globals(), "central": central}
    errors = (TcaError, BadData, BadFormat, TypeError)
    with connect("user", central) as user, pytest.raises(errors) as error:
        exec(textwrap.dedent(mistake.code), {**names, "user": user, "module": Module("m", central)})
    assert type(error.value).__name__ == mistake.error
    check_text(str(error.value), mistake)


WARNINGS = {
    "block without with": Mistake(
        "user.parallel()",
        "", "parallel()", "alone does nothing", "write 'with",
    ),
    "module that is not entered": Mistake(
        "Module('m').running()",
        "", "running()", "alone does nothing", "write 'with",
    ),
    "failure that is nearly a built-in one": Mistake(
        "Failure('module losst')",
        "", "'module losst'", "'module lost'", "give the built-in MODULE_LOST",
    ),
    "misspelt method of a server": Mistake(
        """
        class Rest(Server):
            def initiated(self, task, goal): ...
            def canceled(self, task, why): ...
        Module("m").serve(REST, Rest())
        """,
        "", "Rest.canceled()", "'cancel'", "rename it",
    ),
    "misspelt method of a task": Mistake(
        """
        class Drive(OnceTask):
            def initialize(self): ...
            def iterate(self): ...
        TaskServer("cart", Environment(), tasks=[Drive])
        """,
        "", "Drive.initialize()", "'initialise'", "rename it",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", WARNINGS.values(), ids=WARNINGS)
def test_silent_mistake_is_warned_of(mistake: Mistake, user: Client) -> None:
    with pytest.warns(UserWarning, match=re.escape(mistake.which)) as caught:
        exec(textwrap.dedent(mistake.code), {**vars(tca_module), **globals(), "user": user})
    (warning,) = caught
    check_text(str(warning.message), mistake)


def test_usual_names_and_used_blocks_are_not_warned_of(user: Client) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("timeout", "late", "cup lost", "overheat", "camera error"):
            Failure(name)
        with user.sequence(), user.parallel():
            pass


def test_wrong_option_of_running_is_the_only_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check for a missing ``with`` must not fail after it."""
    ignored: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", ignored.append)
    with pytest.raises(TypeError, match="wrong"):
        Module("m").running(wrong=1)  # type: ignore[call-arg]  # the mistake
    gc.collect()
    assert ignored == []


def test_data_may_be_called_task() -> None:
    @Module("m").handles(LIFT)
    def lift(_: Task, task: float) -> None: ...


def check_text(text: str, mistake: Mistake) -> None:
    assert mistake.what in text
    assert mistake.which in text
    assert re.search(mistake.remedy, text)


PROGRAMS = {
    "program without a central": Mistake(
        "Module('arm', 'ipc:///nowhere/central.sock').run(patience=0.1)",
        "CentralLost", "module 'arm'", "ipc:///nowhere/central.sock", "start it with 'tca central'",
    ),
    "client that is used in a forked process": Mistake(
        """
        import os
        with connect("user") as user:
            if os.fork() == 0:
                user.command(REST)
            os.wait()
        """,
        "MisuseError", "'user'", "forked", r"connect\(\) in each process",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("mistake", PROGRAMS.values(), ids=PROGRAMS)
def test_program_ends_with_the_error_as_its_last_line(mistake: Mistake, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    start = "from tca_module import *\nREST = Command('rest')\n"
    program.write_text(start + textwrap.dedent(mistake.code))
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        done = run(str(program), TCA_CENTRAL=daemon.address)
    (last,) = [line for line in done.stderr.splitlines() if line.startswith("tca_module.errors.")]
    kind, _, text = last.removeprefix("tca_module.errors.").partition(": ")
    assert kind == mistake.error
    check_text(text, mistake)


COMMANDS: dict[str, tuple[list[str], Callable[[Path], object], Mistake]] = {
    "unknown key of a robot's file": (
        ["run", "robot.toml"],
        lambda file: file.write_text("[modules.arm]\ncomand = 'python arm.py'\n"),
        Mistake("", "2", "robot.toml", "modules.arm.comand", "did you mean 'command'"),
    ),
    "program of a robot's file that is missing": (
        ["run", "robot.toml"],
        lambda file: file.write_text("[modules.arm]\ncommand = 'pyton arm.py'\n"),
        Mistake("", "2", "modules.arm.command", "pyton", "there is no executable program"),
    ),
    "journal that does not exist": (
        ["log", "show", "journal"],
        lambda _: None,
        Mistake("", "2", "journal", "no such file", "name a journal directory"),
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("words", "prepare", "mistake"), COMMANDS.values(), ids=COMMANDS)
def test_command_ends_with_one_line_that_tells_the_remedy(
    words: list[str], prepare: Callable[[Path], object], mistake: Mistake, tmp_path: Path
) -> None:
    *command, name = words
    prepare(tmp_path / name)
    done = run("tca", *command, str(tmp_path / name))
    assert done.returncode == int(mistake.error)
    check_text(done.stderr.splitlines()[-1], mistake)
