"""The programs of the robot for the chaos tests: modules, and users that send messages all the
time.

Each program writes its actions into a notebook of its own. A line has the time, the action and its
subject. A written line survives the end of the program.
"""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

from tca_central.__main__ import central
from tca_central.shell import images
from tca_module import (
    CentralLost,
    Client,
    Command,
    ExceptionHandler,
    Goal,
    Inform,
    LockLost,
    Module,
    MultiQuery,
    NotSent,
    PollingMonitor,
    Query,
    QueryFailed,
    Refused,
    SentTask,
    Task,
    TaskFailed,
    TaskKilled,
    Variable,
    connect,
)
from tca_tools.live.central import central as with_stop
from tca_tools.live.central import standby

STEP, GRIP = Command("step", str, result=str), Command("grip", str, result=str)
WALK = Goal("walk", int)
WHERE, SEEN = Query("where", str, reply=str), Query("seen", reply=bool)
HEALTH = MultiQuery("health", str, reply=str)
NOTE = Inform("note", str)
LOOK = PollingMonitor("look", condition=SEEN)
RECOVER = ExceptionHandler("recover")

DOUBTFUL = ("module lost", "uncertain")
"""Failures that cause a retry."""

PATIENCE = 300.0
"""Seconds: longer than a life, so that no program gives up waiting for central."""


class Notebook:
    """The notes of a program about its actions. Each process begins a new notebook."""

    def __init__(self, folder: Path, name: str) -> None:
        path = folder / f"{name.replace(' ', '-')}.{os.getpid()}.notes"
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def note(self, word: str, *about: object) -> None:
        """Write a line."""
        line = f"{time.monotonic_ns()}\t{word}\t" + "\t".join(map(str, about)) + "\n"
        os.write(self._file, line.encode())

    def handling(self, task: Task) -> "Handling":
        """Return a context for the run of a handler."""
        return Handling(self, task)


class Handling:
    """A context that notes the begin and end of a handler's run."""

    def __init__(self, notebook: Notebook, task: Task) -> None:
        self._notebook, self._task = notebook, task

    def __enter__(self) -> None:
        self._notebook.note("begin", self._task.delivery, self._task.id, self._task.message)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._notebook.note(
            "end", self._task.delivery, self._task.id, kind.__name__ if kind else ""
        )


# --- modules --------------------------------------------------------------------------------------


def legs(notebook: Notebook) -> Module:
    """Return the module that takes steps, one at a time."""
    module = Module("legs")

    @module.handles(STEP)
    def step(task: Task, name: str) -> str:
        with notebook.handling(task):
            time.sleep(0.002)
        return name.upper()

    return _healthy(module, notebook)


def hand(notebook: Notebook) -> Module:
    """Return the module that grips things while it holds the lock of the eyes."""
    module = Module("hand")

    @module.handles(GRIP)
    def grip(task: Task, name: str) -> str:
        with notebook.handling(task):
            with task.lock("eyes"):
                notebook.note("locked", name)
                time.sleep(0.003)
                notebook.note("unlocked", name)
            notebook.note("released", name)
        return name.upper()

    return _healthy(module, notebook)


def eyes(notebook: Notebook) -> Module:
    """Return the module that answers queries."""
    module = Module("eyes")

    @module.handles(WHERE)
    def where(task: Task, name: str) -> str:
        with notebook.handling(task):
            return name.upper()

    @module.handles(SEEN)
    def seen(task: Task) -> bool:
        with notebook.handling(task):
            return task.delivery % 2 == 0

    return _healthy(module, notebook)


def planner(notebook: Notebook) -> Module:
    """Return the module that plans walks. A walk is a sequence of steps, watched by a monitor."""
    module = Module("planner")

    @module.handles(WALK)
    def walk(task: Task, steps: int) -> None:
        with notebook.handling(task):
            task.monitor(LOOK, period=0.05, maximum=2)
            with task.sequence():
                for number in range(steps):
                    task.command(STEP, f"{task.delivery}-{number}", delay=0.02 * (number % 2))

    return _healthy(module, notebook)


def expert(notebook: Notebook) -> Module:
    """Return the module that retries lost tasks."""
    module = Module("expert")

    @module.at_start
    def attach(started: Module) -> None:
        started.on_failure(None, RECOVER)

    @module.handles(RECOVER)
    def recover(task: Task) -> None:
        trouble = task.trouble
        if trouble.failure not in DOUBTFUL or trouble.attempts > 9:
            raise trouble.reissue()
        if trouble.failing.message == WALK.name:
            for child in trouble.failing.children():
                child.kill("walked again")
        trouble.failing.retry()

    @module.handles(NOTE)
    def note(task: Task, name: str) -> None:
        with notebook.handling(task):
            notebook.note("noted", name)

    return _healthy(module, notebook)


def _healthy(module: Module, notebook: Notebook) -> Module:
    module.resource("health")

    @module.handles(HEALTH, resource="health")
    def health(task: Task, name: str) -> str:
        with notebook.handling(task):
            return f"{name} {module.name}"

    return module


MODULES: dict[str, Callable[[Notebook], Module]] = {
    one.__name__: one for one in (legs, hand, eyes, planner, expert)
}


def be_central(events_between: int, folder: Path) -> None:
    """Run ``tca central`` with frequent images of its state."""
    images.EVENTS_BETWEEN = events_between
    central(["--journal", str(folder / "journal")], prog_name="tca central")


def be_member(command: str, events_between: int, options: list[str], _folder: Path) -> None:
    """Run ``tca central`` or ``tca standby`` with frequent images of its state."""
    images.EVENTS_BETWEEN = events_between
    {"central": with_stop, "standby": standby}[command](options, prog_name=f"tca {command}")


def serve(name: str, folder: Path) -> None:
    """Run a module until it is terminated."""
    log_with_times()
    MODULES[name](Notebook(folder, name)).run(
        patience=60
    )  # central may start late on a busy machine


def log_with_times() -> None:
    logging.basicConfig(format="%(asctime)s %(process)d %(message)s", level=logging.INFO)


# --- users ----------------------------------------------------------------------------------------


class User:
    """A program that sends a few messages at a time, and notes their outcomes."""

    def __init__(self, name: str, folder: Path, seed: int) -> None:
        self.name = name
        self.random = Random(seed)
        self.notebook = Notebook(folder, name)
        self.speed = Variable(f"speed of {name}", int)
        self.count = 0
        self.sent: list[tuple[str, SentTask[Any]]] = []

    def live(self, until: Path) -> None:
        """Act until a file exists, then wait for all open tasks."""
        deeds: list[Callable[[Client, str], None]] = [
            self.step,
            self.walk,
            self.grip,
            self.where,
            self.inform,
            self.set,
        ]
        deeds += [
            self.step,
            self.walk,
            self.step,
            self.where,
            self.step,
            self.ask_all,
            self.step,
            self.lock,
        ]
        if self.name != "guest":  # a killed guest would leave its suspended tasks for ever
            deeds.append(self.suspend)
        try:
            with connect(self.name, patience=PATIENCE, linger=60.0) as user:
                while not until.exists():
                    name = self._next()
                    try:
                        self.random.choice(deeds)(user, name)
                    except CentralLost:  # only if the line to a living central broke
                        self.notebook.note("cut off", name)
                    while len(self.sent) > self.random.randrange(12):
                        self.await_oldest()
                    time.sleep(self.random.random() * 0.01)
                while self.sent:
                    self.await_oldest()
        except NotSent as error:
            self.notebook.note("not sent", error.number)
        self.notebook.note("over")

    def _next(self) -> str:
        self.count += 1
        return f"{self.name}{os.getpid()}n{self.count}"

    def _send(self, name: str, task: SentTask[Any]) -> None:
        self.sent.append((name, task))
        if self.random.random() < 0.5:
            self.notebook.note("taken", name, task.id)

    def await_oldest(self) -> None:
        """Wait for the oldest task."""
        name, task = self.sent.pop(0)
        self.notebook.note("awaits", name)
        try:
            result = task.result()
        except CentralLost:
            self.notebook.note("cut off", name)
            return
        except (TaskFailed, TaskKilled) as error:
            failure = error.failure if isinstance(error, TaskFailed) else "killed"
            self.notebook.note("failed", name, task.id, failure)
            return
        assert result in (name.upper(), None), (name, result)
        self.notebook.note("done", name, task.id)

    def step(self, user: Client, name: str) -> None:
        """Send a step that waits for the earlier ones, or does not."""
        self._send(name, user.command(STEP, name, sequential=self.random.random() < 0.5))

    def grip(self, user: Client, name: str) -> None:
        """Send a grip."""
        self._send(name, user.command(GRIP, name, sequential=False))

    def walk(self, user: Client, name: str) -> None:
        """Send a walk, beside all other tasks."""
        self._send(name, user.goal(WALK, self.random.randrange(1, 5), sequential=False))

    def suspend(self, user: Client, name: str) -> None:
        """Send a suspended step, and resume it."""
        task = user.command(STEP, name, sequential=False, suspended=True)
        task.resume()
        self._send(name, task)

    def where(self, user: Client, name: str) -> None:
        """Send a query."""
        self.notebook.note("asks", name)
        try:
            reply = user.query(WHERE, name, timeout=None)
        except QueryFailed as error:
            self.notebook.note("unanswered", name, error.failure)
            return
        assert reply == name.upper(), (name, reply)
        self.notebook.note("answered", name)

    def ask_all(self, user: Client, name: str) -> None:
        """Send a multi-query."""
        self.notebook.note("asks", name)
        try:
            replies = user.multi_query(HEALTH, name)
        except QueryFailed as error:
            self.notebook.note("unanswered", name, error.failure)
            return
        assert all(reply.split()[0] == name for reply in replies), (name, replies)
        assert len(set(replies)) == len(replies), replies
        self.notebook.note("answered", name, len(replies))

    def inform(self, user: Client, name: str) -> None:
        """Send an inform."""
        user.inform(NOTE, name)
        self.notebook.note("told", name)

    def set(self, user: Client, _name: str) -> None:
        """Set and read a variable that no other user sets."""
        user.set_variable(self.speed, self.count)
        assert user.get_variable(self.speed) == self.count

    def lock(self, user: Client, name: str) -> None:
        """Lock the eyes for a while."""
        try:
            with user.lock("eyes"):
                self.notebook.note("locked", name)
                time.sleep(0.002)
                self.notebook.note("unlocked", name)
            self.notebook.note("released", name)
        except (LockLost, Refused):  # no module has eyes just now
            pass


def use(name: str, seed: int, folder: Path) -> None:
    """Run a user until the file "over" exists."""
    log_with_times()
    User(name, folder, seed).live(folder / "over")
