"""Programs that die inside a handler, in several ways.

Waiting clients are notified, and locks are released. A message that kills its handler is not
retried without a decision.
"""

import signal
from contextlib import ExitStack
from pathlib import Path

import pytest
from module.real_central import until
from processes import central, program

from tca_central.requests.joining import MOST_AHEAD
from tca_module import (
    Client,
    Command,
    ExceptionHandler,
    Module,
    Query,
    QueryFailed,
    Recovery,
    TaskFailed,
    connect,
)

pytestmark = pytest.mark.slow

SOON = 30.0

DIES = """
import ctypes, os, sys, time
from tca_module import Command, Module, Task
module = Module("m")

@module.handles(Command("work"))
def work(task: Task) -> None:
    with task.lock("camera"):
        os.write(1, b"begun\\n")  # avoids the lock of stdout, which would keep Python from exiting
        {how}
"""
RUN = "module.run()"
WAYS = {
    "crash": ("ctypes.string_at(0)", RUN, -signal.SIGSEGV),
    "exit": ("os._exit(0)", RUN, 0),
    "exec": ("os.execv('/bin/true', ['true'])", RUN, 0),
    "main thread": (
        "time.sleep(60)",
        "block = module.running(); block.__enter__(); sys.stdin.readline()",
        0,
    ),
    "SIGTERM": (
        "os.kill(os.getpid(), 15); time.sleep(60)",
        "with module.running(): sys.stdin.read()",
        -15,
    ),
}


def test_task_fails_and_lock_is_free_when_handler_process_dies(tmp_path: Path) -> None:
    """The handler's lock is released, and the module disappears from central's list."""
    with central(tmp_path) as daemon, connect("user", daemon.address) as user:
        eyes = Module("eyes", daemon.address)
        eyes.resource("camera")
        eyes.handles(Command("photo"), resource="camera")(lambda _: None)
        with eyes.running():
            for how, end, code in WAYS.values():
                with program(DIES.replace("{how}", how) + end + "\n", daemon.address) as dying:
                    user.wait_until_handled(Command("work"), timeout=SOON)
                    work = user.command(Command("work"))
                    dying.hear("begun")
                    if "readline" in end:
                        dying.communicate("x\n")
                    with pytest.raises(TaskFailed, match="module lost: module 'm' was lost"):
                        work.result(timeout=SOON)
                    assert dying.wait(SOON) == code, dying.stderr and dying.stderr.read()
                user.lock("camera", timeout=SOON).release()
                until(
                    lambda: {module.name for module in user.modules()} == {"user", "eyes"},
                    "it is forgotten",
                )


AGAIN = ExceptionHandler("again")
POOL = """
import ctypes, os, pathlib, sys
from typing import NoReturn
from tca_module import Command, Module, Query, Task
module = Module("m")

def die(_: Task) -> NoReturn:
    with open(os.environ["BEGUN"], "a") as file:
        file.write("begun\\n")
    ctypes.string_at(0)

module.handles(Command("poison"), pool="pool")(die)
module.handles(Query("bad question", reply=int), pool="pool")(die)
print("runs", flush=True)
module.run()
"""


def test_message_that_kills_its_handler_is_not_rerouted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "begun"
    monkeypatch.setenv("BEGUN", str(log))
    poison, question = Command("poison"), Query("bad question", reply=int)
    with (
        central(tmp_path) as daemon,
        ExitStack() as programs,
        connect("user", daemon.address) as user,
    ):
        pool = [programs.enter_context(program(POOL, daemon.address)) for _ in range(4)]
        until(
            lambda: sum("m" in module.name for module in user.modules()) == len(pool),
            "the pool is there",
        )
        user.wait_until_handled(poison, question, timeout=SOON)
        with pytest.raises(QueryFailed, match="module lost"):
            user.query(question, timeout=SOON)
        assert log.read_text().count("begun") == 1
        retrier = Module("retrier", daemon.address)
        retrier.handles(AGAIN)(lambda task: task.trouble.failing.retry() and None)
        with retrier.running(), pytest.raises(TaskFailed, match="module lost"):
            user.command(poison, on_failure=[Recovery(None, AGAIN, maximum=1)]).result(timeout=SOON)
        assert log.read_text().count("begun") == 3
        assert sum(one.poll() is None for one in pool) == 1


MANY = """
import time
from contextlib import ExitStack
from tca_module import Command, Module
modules = [Module(f"m{number}") for number in range(50)]
for module in modules:
    module.handles(Command(f"work {module.name}"))(lambda task: task.wait_until_handled(Command("never")))
with ExitStack() as running:
    for module in modules:
        running.enter_context(module.running())
    time.sleep(100)
"""

STANDS = """
import time
from tca_module import Command, Module
module = Module("m")
module.handles(Command("work"))(lambda _: [print("begun", flush=True), time.sleep(60)] and None)
module.run()
"""


def test_central_ends_at_once_despite_a_stopped_module(tmp_path: Path) -> None:
    with (
        central(tmp_path) as daemon,
        program(MANY, daemon.address),
        connect("user", daemon.address) as user,
    ):
        with program(STANDS, daemon.address) as stopped:
            user.wait_until_handled(
                Command("work"), *(Command(f"work m{n}") for n in range(50)), timeout=SOON
            )
            work = [
                user.command(Command(f"work m{number}"), sequential=False) for number in range(50)
            ]
            work.append(user.command(Command("work"), sequential=False))
            assert all(one.id for one in work)
            stopped.hear("begun")
            stopped.send_signal(signal.SIGSTOP)
            assert [user.command(Command("work"), sequential=False).id for _ in range(20)]
            daemon.signal(signal.SIGTERM)
            assert daemon.process.wait(5) == 0


# --- a process is killed while it has prefetched messages ------------------------------------------


DOUBLE = Query("double", int, reply=int)
PATIENCE, RUNS, DEADLY, LOST = 20.0, 400, -1, "module lost"

QUICK = """
    import os
    import signal
    from tca_module import Module, Query, Task
    quick = Module("quick")

    @quick.handles(Query("double", int, reply=int))
    def double(_: Task, number: int) -> int:
        if number < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return 2 * number

    quick.run()
"""


def answers(user: Client, numbers: list[int], address: str) -> list[int | str]:
    """Send queries together, and return their replies or failures. A second module starts while
    they wait.
    """
    pending = [user.query_send(DOUBLE, number) for number in numbers]
    found: list[int | str] = []
    with program(QUICK, address):
        for one in pending:
            try:
                found.append(one.receive(PATIENCE))
            except QueryFailed as lost:
                found.append(lost.failure)
    return found


def test_killed_module_loses_only_its_prefetched_queries(tmp_path: Path) -> None:
    with (
        central(tmp_path) as daemon,
        connect("user", daemon.address) as user,
        program(QUICK, daemon.address),
    ):
        for number in range(20):
            assert user.query(DOUBLE, number, timeout=PATIENCE) == 2 * number
        numbers = [*range(RUNS), DEADLY, *range(RUNS)]
        found = answers(user, numbers, daemon.address)
    assert found[RUNS] == LOST
    assert found.count(LOST) <= MOST_AHEAD + 1
    assert all(answer in (LOST, 2 * number) for number, answer in zip(numbers, found, strict=True))
