"""A forked process must not use its parent's connections. Each call raises at once, and no call
waits.
"""

import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, RealCentral, until

from tca_module import Command, LaterReply, MisuseError, Module, Query, Task, connect
from tca_module.client import Client

MOVE, WHERE = Command("move", int, result=int, progress=int), Query("where", reply=int)
UNHANDLED = Query("unhandled", reply=int)

held: dict[str, Any] = {}
"""The objects that a program may hold when it is forked."""

USES: list[tuple[str, Callable[[Any], Any]]] = [
    ("user", lambda user: user.query(WHERE, timeout=1)),
    ("user", lambda user: user.status()),
    ("user", lambda user: user.command(MOVE, 1)),
    ("sent", lambda sent: sent.result(1)),
    ("sent", lambda sent: sent.state),
    ("sent", lambda sent: sent.kill()),
    ("changes", next),
    ("asked", lambda asked: asked.receive(1)),
    ("notified", lambda notified: notified.cancel()),
    ("claim", lambda claim: claim.held),
    ("claim", lambda claim: claim.release()),
    ("owed", lambda owed: owed.report(1)),
    ("owed", lambda owed: owed.reply(1)),
    ("owed", lambda owed: owed.cancelled),
    ("module", lambda module: module.query(WHERE)),
    ("module", lambda module: module.after(0, print)),
]


def hold(module: Module, user: Client, owed: LaterReply[int]) -> None:
    sent = user.command(MOVE, 2, suspended=True)
    held.update(module=module, user=user, owed=owed, sent=sent, changes=sent.changes())
    held.update(asked=user.query_send(WHERE), notified=user.query_notify(UNHANDLED, None, print))
    held.update(claim=user.lock("arm"))


def in_child(address: str) -> int:
    """Try all uses, and close the inherited client. Then query with a new connection."""
    for name, use in USES:
        with pytest.raises(MisuseError, match=r"connect\(\) in each process"):
            print(name, use(held[name]))
    held["user"].close()
    with connect("child", address) as client:
        return client.query(WHERE, timeout=SOON)


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
@pytest.mark.parametrize("others", ["", ",ipc:///none"])
def test_forked_process_gets_misuse_at_each_inherited_use(tmp_path: Path, others: str) -> None:
    owed: list[LaterReply[int]] = []
    with RealCentral(f"ipc://{tmp_path}/central") as central:
        address = central.address + others
        module = Module("legs", address)

        @module.handles(MOVE)
        def move(task: Task, _: int) -> LaterReply[int]:
            owed.append(task.reply_later())
            return owed[-1]

        module.handles(WHERE, resource="head")(lambda _: 5)
        module.handles(Command("wave"), resource="arm")(lambda _: None)
        with module.running(), connect("user", address) as user:
            moved = user.command(MOVE, 1)
            assert user.query(WHERE, timeout=SOON) == 5
            until(lambda: owed, "the move is handled")
            hold(module, user, owed[0])
            with multiprocessing.get_context("fork").Pool(1) as pool:
                assert pool.apply_async(in_child, (address,)).get(SOON) == 5
            held["claim"].release()
            held["sent"].kill()
            owed[0].reply(7)
            assert moved.result(SOON) == 7
            held.clear()
