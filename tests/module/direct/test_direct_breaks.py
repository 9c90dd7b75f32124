"""Direct messages when something breaks, dies or is foreign."""

import os
import socket
import threading
from pathlib import Path

import pytest
import zmq
from module.direct_maps import HEIGHT, a_map, ask_until_direct
from module.real_central import SOON, RealCentral, until

from tca_module import CentralLost, Client, Module, connect
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Delivered

pytestmark = pytest.mark.usefixtures("attentive")


def test_a_sender_whose_connection_to_central_broke_learns_the_way_anew(central: RealCentral, user: Client) -> None:
    with a_map(central).running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        connection = user._connection()
        connection.session.break_off()
        assert user.query(HEIGHT, -1.0) == 1.0  # goes on while it is away
        user.status()
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))


def test_direct_messages_flow_while_central_is_gone(tmp_path: Path) -> None:
    """What is under way when another central comes is lost, as through central; then all is learnt anew."""
    address = f"ipc://{tmp_path}/central.sock"
    begun, go_on = threading.Event(), threading.Event()

    def slow(x: float) -> float:
        if x < 0:
            begun.set()
            go_on.wait(SOON)
        return x

    central = RealCentral(address)
    module = a_map(address, height=slow)
    with module.running(), connect("user", address) as user:
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        central.close()
        for x in range(100):
            assert user.query(HEIGHT, float(x)) == x
        pending = user.query_send(HEIGHT, -1.0)
        assert begun.wait(SOON)
        with RealCentral(address, "another run") as central:
            with pytest.raises(CentralLost, match="central was restarted meanwhile and has forgotten it"):
                pending.receive(SOON)
            go_on.set()
            ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))


def entrance(folder: Path) -> Path:
    (path,) = folder.glob("*.direct")
    return path


def test_strangers_at_the_entrance_harm_nobody(central: RealCentral, user: Client, tmp_path: Path) -> None:
    with a_map(central).running():
        ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
        path = entrance(tmp_path)
        assert path.stat().st_mode & 0o777 == 0o600
        with zmq.Context() as context, context.socket(zmq.DEALER) as stranger:
            stranger.connect(f"ipc://{path}")
            for frames in ([b"garbage"], [b""], [b"a", b"b", b"c"], [os.urandom(1000)], [b"\xff" * 16]):
                stranger.send_multipart(frames)
                assert stranger.poll(int(SOON * 1000))
                assert b"protocol" in stranger.recv()
        assert user.query(HEIGHT, -2.0) == 2.0
    until(lambda: not path.exists(), "the entrance is gone")


def test_what_killed_modules_left_behind_is_cleared_away(central: RealCentral, tmp_path: Path) -> None:
    with zmq.Context() as context, context.socket(zmq.ROUTER) as alive:
        gone, taken, foreign = (tmp_path / f"{name}.direct" for name in ("4194305-a", "4194306-b", "notes"))
        alive.bind(f"ipc://{gone}")
        gone_too = tmp_path / "4194307-c.direct"
        gone.rename(gone_too)  # as if its process were on another machine: it still answers
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(taken))
        foreign.touch()
        with a_map(central).running():
            assert not taken.exists()
            assert gone_too.exists()
            assert foreign.exists()


def test_over_tcp_the_entrance_is_where_central_is_reached(tmp_path: Path) -> None:
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address) as user:
        with a_map(central).running():
            ask_until_direct(central, lambda: user.query(HEIGHT, 0.0))
            ((path,),) = user._connection().direct._routes._routes.values()
            assert path.entrance.endpoint.startswith("tcp://127.0.0.1:")
        assert not list(tmp_path.iterdir())


def test_a_folder_that_is_too_deep_costs_the_direct_way_only(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path
    while len(str(folder)) < 84:
        folder = folder / ("x" * min(10, 84 - len(str(folder))))
    folder.mkdir(parents=True)
    with RealCentral(f"ipc://{folder}/c") as central, connect("user", central.address) as user:
        with a_map(central).running():
            assert user.query(HEIGHT, -1.0) == 1.0
        assert "all goes through central" in caplog.text


def test_with_a_local_central_all_goes_through_its_core() -> None:
    with LocalCentral(check=True) as central, connect("user", central) as user:
        module = Module("map", central)
        module.handles(HEIGHT, direct=True)(lambda _, x: -x)
        with module.running():
            assert [user.query(HEIGHT, 1.0) for _ in range(5)] == [-1.0] * 5
        assert sum(isinstance(fact, Delivered) for fact in central.facts) == 5
