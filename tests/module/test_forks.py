"""A forked process must not use what its parent has opened: each call says so at once, and nothing waits."""

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, RealCentral

from tca_module import Command, LaterReply, MisuseError, Module, Query, Task, connect
from tca_module.client import Client

MOVE, WHERE = Command("move", int, result=int, progress=int), Query("where", reply=int)


class Held:
    """What a program may hold when it is forked."""

    def __init__(self, module: Module, user: Client, owed: LaterReply[int]) -> None:
        self.module, self.user, self.owed = module, user, owed
        self.sent = user.command(MOVE, 2, suspended=True)
        self.sent.follow()
        self.changes = self.sent.changes()
        self.asked = user.query_send(WHERE)
        self.notified = user.query_notify(WHERE, None, lambda *_: None)
        self.claim = user.lock("head")


USES: dict[str, Callable[[Held], Any]] = {
    "query": lambda held: held.user.query(WHERE, timeout=1),
    "command": lambda held: held.user.command(MOVE, 1),
    "status": lambda held: held.user.status(),
    "result": lambda held: held.sent.result(1),
    "state": lambda held: held.sent.state,
    "kill": lambda held: held.sent.kill(),
    "next change": lambda held: next(held.changes),
    "receive": lambda held: held.asked.receive(1),
    "cancel": lambda held: held.notified.cancel(),
    "held": lambda held: held.claim.held,
    "release": lambda held: held.claim.release(),
    "reply": lambda held: held.owed.reply(1),
    "report": lambda held: held.owed.report(1),
    "cancelled": lambda held: held.owed.cancelled,
    "module": lambda held: held.module.query(WHERE),
    "after": lambda held: held.module.after(0, lambda: None),
}


def what_is_wrong(held: Held) -> list[str]:
    """The uses in a forked child that are not refused as they should be."""
    found = []
    for name, use in USES.items():
        try:
            found.append(f"{name}: {use(held)!r}")
        except MisuseError as error:
            if "connect() in each process" not in str(error):
                found.append(f"{name}: {error}")
        except BaseException as error:  # noqa: BLE001
            found.append(f"{name}: {error!r}")
    return found


def in_child(function: Callable[[], object]) -> str:
    """The word of a function in a forked child; what it leaves behind is collected there, too."""
    reads, writes = os.pipe()
    if not (child := os.fork()):
        try:
            said = f"{function()}"
        except BaseException as error:  # noqa: BLE001
            said = f"{error!r}"
        os.write(writes, said.encode())
        os._exit(0)
    os.close(writes)
    killer = threading.Timer(SOON, os.kill, (child, 9))
    killer.start()
    with os.fdopen(reads) as pipe:
        said = pipe.read()
    killer.cancel()
    os.waitpid(child, 0)
    return said


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_is_told_at_each_use(tmp_path: Path) -> None:
    owed: list[LaterReply[int]] = []
    with RealCentral(f"ipc://{tmp_path}/central") as central:
        module = Module("legs", central.address)

        @module.handles(MOVE)
        def move(task: Task, _: int) -> LaterReply[int]:
            owed.append(task.reply_later())
            return owed[-1]

        module.handles(WHERE, resource="head")(lambda _: 5)
        with module.running(), connect("user", central.address) as user:
            moved = user.command(MOVE, 1)
            assert user.query(WHERE, timeout=SOON) == 5
            held = Held(module, user, owed[0])
            assert in_child(lambda: what_is_wrong(held)) == "[]"
            assert in_child(user.close) == "None"
            held.claim.release()
            assert in_child(lambda: child_of_its_own(central.address)) == "5"
            held.sent.kill()
            owed[0].reply(7)
            assert moved.result(SOON) == 7


def child_of_its_own(address: str) -> int:
    with connect("child", address) as client:
        return client.query(WHERE, timeout=SOON)
