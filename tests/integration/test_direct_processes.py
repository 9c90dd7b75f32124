"""Direct messages between processes that are killed."""

import signal
from pathlib import Path

import pytest
from module.real_central import until
from processes import Central, Process, central, program, tca

from tca_module import Client, Inform, NotSent, PendingReply, Query, QueryFailed, connect
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log

pytestmark = pytest.mark.slow

HEIGHT = Query("height", float, reply=float)
POSE = Inform("pose", float)
SOON = 20.0

MAP = """
    import time
    from tca_module import Inform, Module, Query, Task
    HEIGHT = Query("height", float, reply=float)
    POSE = Inform("pose", float)
    map_ = Module("map")

    @map_.handles(HEIGHT, direct=True)
    def height(_: Task, x: float) -> float:
        if x < 0:
            print("begun", flush=True)
            time.sleep(60)
        return x

    @map_.handles(POSE, direct=True)
    def pose(_: Task, x: float) -> None: ...

    with map_.running():
        print("runs", flush=True)
        map_._stop.wait()
"""


def ask_until_direct(daemon: Central, user: Client) -> None:
    def goes_directly() -> bool:
        assert user.query(HEIGHT, 1.0, timeout=SOON) == 1.0
        return any(one.direct_from for one in History.until(open_log(daemon.journal)).handlings)

    until(goes_directly, "queries go directly", SOON)


def begin_slow_query(user: Client, module: Process) -> PendingReply[float]:
    pending = user.query_send(HEIGHT, -1.0)
    module.hear("begun")
    return pending


def test_direct_query_fails_when_its_handler_module_is_killed(tmp_path: Path) -> None:
    """The query fails like a query through central. The next query waits for the next handler."""
    with central(tmp_path) as daemon, connect("user", daemon.address) as user:
        with program(MAP, daemon.address) as module:
            module.hear("runs")
            ask_until_direct(daemon, user)
            pending = begin_slow_query(user, module)
            queued = user.query_send(HEIGHT, 2.0)
            module.send_signal(signal.SIGKILL)
            for one in (pending, queued):
                with pytest.raises(
                    QueryFailed, match="module lost: module 'map' was lost: its connection closed"
                ):
                    one.receive(SOON)
        (left_behind,) = tmp_path.glob("*.direct")
        with program(MAP, daemon.address):
            assert user.query(HEIGHT, 3.0, timeout=SOON) == 3.0
            ask_until_direct(daemon, user)
            assert not left_behind.exists()
    shown = tca("log", "show", str(daemon.journal), "--kind", "direct").stdout
    assert "direct         height from user to map, 9 bytes, " in shown


def test_direct_informs_to_a_killed_module_are_reported_lost(tmp_path: Path) -> None:
    """The sender counts the informs that may be unhandled. It reports this number to central, in
    its log, and when it leaves.
    """
    with central(tmp_path) as daemon, program(MAP, daemon.address) as module:
        user = connect("user", daemon.address, linger=SOON)
        module.hear("runs")
        ask_until_direct(daemon, user)
        user.inform(POSE, 0.0)  # goes through central, which sends the route
        user.status()  # once central answers, the user has the route
        begin_slow_query(user, module)
        for number in range(300):
            user.inform(POSE, float(number))
        module.send_signal(signal.SIGKILL)
        with pytest.raises(
            NotSent,
            match=r"^300 messages of 'user' may not have reached their handler, which was disconnected",
        ):
            user.close()
        with connect(
            "other", daemon.address
        ) as other:  # else central may end before it received the report
            until(
                lambda: "user" not in {module.name for module in other.modules()},
                "its goodbye is heard",
            )
    assert (
        "direct lost    user: 300 of pose"
        in tca("log", "show", str(daemon.journal), "--kind", "direct lost").stdout
    )
