"""The daemon as a process: normal use, restarts, and malformed input."""

import os
import signal
import socket as sockets
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zmq
from click.testing import CliRunner
from module.real_central import RealCentral
from processes import central, program

from tca_central.__main__ import central as central_command
from tca_central.shell.log_lines import LineFormatter
from tca_central.shell.server import Daemon
from tca_module import (
    CentralLost,
    Client,
    Command,
    Failure,
    Goal,
    Module,
    Outcome,
    Query,
    Task,
    TaskFailed,
    Variable,
    connect,
)
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_wire.endpoint import default_journals
from tca_wire.journal import facts
from tca_wire.packets import codec, headers

pytestmark = pytest.mark.slow

SQUARE = Query("square", int, reply=int)
MOVE = Command("move", int, result=int)
WALK = Goal("walk", int)

SQUARES = """
    from tca_module import *
    module = Module("squares")
    @module.handles(Query("square", int, reply=int))
    def square(task: Task, number: int) -> int:
        return number * number
    with module.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""

MOVES = """
    import os, sys, time
    from tca_module import *
    module = Module("legs")
    @module.handles(Command("move", int, result=int))
    def move(task: Task, number: int) -> int:
        print("moving", flush=True)
        if number < 0:
            os.kill(os.getpid(), 9)
        while number > 100 and not task.cancelled:
            time.sleep(0.01)
        return number
    with module.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""

MOVES_UNTIL_TERMINATED = (
    MOVES.partition("    with module")[0]
    + """
    print("ready", flush=True)
    module.run()
"""
)


def test_central_process_routes_tasks_and_reports_killed_module(tmp_path: Path) -> None:
    with central(tmp_path, bind="tcp://127.0.0.1:*") as daemon:
        address = daemon.first_line.rpartition(" ")[2]
        with (
            program(SQUARES, address) as squares,
            program(MOVES, address) as legs,
            connect("user", address) as user,
        ):
            squares.hear("ready")
            legs.hear("ready")
            assert user.query(SQUARE, 12) == 144
            assert user.command(MOVE, 5).result(timeout=10) == 5
            with pytest.raises(TaskFailed, match="module lost"):
                user.command(MOVE, -1).result(timeout=20)
            assert user.query(SQUARE, 3) == 9
        assert "module 'squares' joined" in daemon.stop()
    history = History.until(open_log(daemon.journal))
    assert [message.name for message in history.messages.values()] == [
        "square",
        "move",
        "move",
        "square",
    ]


def test_malformed_packets_do_not_disturb_other_clients(tmp_path: Path) -> None:
    with (
        central(tmp_path) as daemon,
        program(SQUARES, daemon.address) as squares,
        connect("user", daemon.address) as user,
    ):
        squares.hear("ready")
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        enemy = context.socket(zmq.DEALER)
        enemy.linger = 0
        enemy.connect(daemon.address)
        hello = codec.pack([(headers.Hello(1, headers.PROTOCOL_VERSION, "enemy", "x"), b"")])
        future = codec.pack([(headers.Hello(1, 99, "enemy", "x"), b"")])
        send = codec.pack([(headers.Send(2, "square"), b"\xd9\xc1")])
        enemy.send(send)
        assert enemy.poll(20_000), "frames sent before the connection would be lost on close"
        for frames in (
            [b""],
            [b"garbage"],
            [os.urandom(5000)],
            [b"a", b"b", b"c"],
            [future],
            [send],
            [hello],
            [send],
            [codec.pack([(headers.Reply(77), b"")])],
            [b"\xff" * 100],
            [hello[:-1]],
            [hello * 2000],
        ):
            enemy.send_multipart(frames)
            assert user.query(SQUARE, 7) == 49
        with sockets.socket(sockets.AF_UNIX) as raw:
            raw.connect(daemon.address.removeprefix("ipc://"))
            raw.sendall(os.urandom(1000))
            assert user.query(SQUARE, 8) == 64
        enemy.close()
        context.term()
        output = daemon.stop()
    assert f"speaks protocol 99, central {headers.PROTOCOL_VERSION}: use one version" in output
    assert "3 frames; a packet is one" in output
    assert "Traceback" not in output


StartRefused = Callable[..., str]


@pytest.fixture
def start_refused(monkeypatch: pytest.MonkeyPatch) -> StartRefused:
    """Return a function that tries to start a central with options, and returns the error text."""
    monkeypatch.setattr(Daemon, "serve", lambda _: pytest.fail("it has started"))

    def start(*options: str) -> str:
        result = CliRunner().invoke(central_command, options)
        assert result.exit_code in (1, 2)
        assert isinstance(result.exception, SystemExit)
        return " ".join(result.stderr.split())

    return start


def test_second_central_is_refused_address_and_journal_in_use(
    tmp_path: Path, start_refused: StartRefused
) -> None:
    with central(tmp_path) as daemon:
        before = sorted(path.name for path in daemon.journal.iterdir())
        output = start_refused("--bind", daemon.address, "--no-journal")
        assert f"can't listen on {daemon.address}: another central uses it; stop it" in output
        output = start_refused(
            "--bind", f"ipc://{tmp_path}/other.sock", "--journal", str(daemon.journal)
        )
        assert "another central writes its journal there: name another folder" in output
        assert sorted(path.name for path in daemon.journal.iterdir()) == before
        with connect("user", daemon.address) as user:
            assert user.status("status")["modules"] == 1


def test_start_error_names_the_port_in_use(start_refused: StartRefused) -> None:
    with sockets.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        output = start_refused("--bind", f"tcp://127.0.0.1:{port}", "--no-journal", "--insecure")
    assert f"can't listen on tcp://127.0.0.1:{port}: another program uses it" in output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--bind", "tcp://0.0.0.0:5555", "--insecure"], "every program needs a key"),
        (["--bind", "nonsense"], "'nonsense' is not an address"),
        (["--bind", "ipc:///tmp/a,ipc:///tmp/b"], "give one with --bind"),
        (["--bind", "tcp://127.0.0.1:99999"], "is not an address"),
        (["--bind", "ipc:///proc/nothing/central.sock"], "can't listen on"),
        (["--journal", "/proc/nothing"], "name another folder with --journal"),
        (["--sync", "sometimes"], "sometimes"),
        (
            ["--lost-after", "1"],
            "1 is too short to tell a stopped process from a busy computer: give 2 or more",
        ),
    ],
)
def test_start_error_explains_invalid_option(
    tmp_path: Path, start_refused: StartRefused, options: list[str], words: str
) -> None:
    assert words in start_refused("--bind", f"ipc://{tmp_path}/central.sock", *options)


def test_fresh_run_starts_in_folder_of_crashed_run(tmp_path: Path) -> None:
    """Each run has its own segments in the folder. The earlier run gains only the record of its
    end.
    """
    with central(tmp_path) as first:
        with connect("early", first.address) as user:
            user.modules()
        first.kill()
    before = {path.name: path.read_bytes() for path in first.journal.iterdir()}
    with central(tmp_path, "--fresh") as second, connect("late", second.address) as user:
        user.modules()
        assert second.journal == first.journal
    found = {path.name: path.read_bytes() for path in first.journal.iterdir()}
    assert sorted(found) == ["00000001.tcai", "00000001.tcaj", "00000002.tcai", "00000002.tcaj"]
    assert found["00000001.tcaj"] == before["00000001.tcaj"]
    assert found["00000001.tcai"].startswith(before["00000001.tcai"])
    log = open_log(first.journal)
    assert [path.name for path in log.segments()] == ["00000002.tcaj"]
    assert "late" in str(list(log))
    assert not log.cut
    assert "early" in str(list(open_log(first.journal / "00000001.tcaj")))
    links = [
        path
        for path in default_journals().iterdir()
        if path.is_symlink() and path.resolve() == first.journal
    ]
    assert len(links) == 1


def test_tasks_survive_module_handovers_under_load(tmp_path: Path) -> None:
    with (
        central(tmp_path) as daemon,
        connect("user", daemon.address) as user,
        ExitStack() as programs,
    ):
        legs = programs.enter_context(program(MOVES_UNTIL_TERMINATED, daemon.address))
        for _ in range(2):
            moves = [user.command(MOVE, number, sequential=False) for number in range(20)]
            successor = programs.enter_context(program(MOVES_UNTIL_TERMINATED, daemon.address))
            while sum("move" in module["handles"] for module in user.status("modules")) < 2:
                time.sleep(0.01)
            moves += [user.command(MOVE, number, sequential=False) for number in range(20, 40)]
            legs.send_signal(signal.SIGTERM)
            assert [move.result(timeout=20) for move in moves] == list(range(40))
            assert legs.wait(timeout=10) == 0
            legs = successor
        assert "its connection closed" not in daemon.stop()


BROKEN = """
    from tca_central import core
    from tca_central.__main__ import central
    from tca_wire.packets import headers
    def broken(*_):
        assert False, "the cat is both dead and alive"
    core.HANDLERS[headers.GetVariable] = broken
    print("ready", flush=True)
    central(["--journal", {journal!r}])
"""


def test_internal_error_ends_central_with_its_reason(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    address, journal = f"ipc://{tmp_path}/central.sock", tmp_path / "journal"
    with program(BROKEN.format(journal=str(journal)), address) as daemon:
        with connect("user", address, patience=3.0) as user:
            user.goal(WALK, 1)
            with pytest.raises(CentralLost):
                user.get_variable(Variable("mode", int))
        output = daemon.communicate(timeout=10)[1]
    assert daemon.returncode == 1
    assert "central ends: internal error: AssertionError in event" in caplog.text
    assert "the cat is both dead and alive" in output
    assert (
        "GetVariable of module 'user'; this is a bug in central, please report it with the journal"
        in output
    )
    log = open_log(journal)
    entries = list(log)
    log.check()
    assert any(
        isinstance(fact, facts.Received) and fact.message == "walk"
        for entry in entries
        for fact in entry.facts
    )
    (failed,) = entries[-1].facts
    assert isinstance(failed, facts.CentralFailed)
    assert failed.why.startswith("internal error: AssertionError in event")


def test_failure_is_logged_as_one_printable_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The log shows the first line of the failure's text, without control characters."""
    with caplog.at_level("INFO"), RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        legs = Module("legs", daemon.address)

        @legs.handles(MOVE)
        def move(task: Task, number: int) -> int:
            raise Failure("stuck")(None, "in \x1b[2Jthe mud\nand deep" if number else "")

        with legs.running():
            for number in (1, 0):
                assert legs.command(MOVE, number).wait() is Outcome.FAILED
    lines = map(LineFormatter().format, caplog.records)
    assert [line for line in lines if "failure '" in line] == [
        r"failure 'stuck' of move {1}: in \x1b[2Jthe mud ...",
        "failure 'stuck' of move {2}",
    ]


PARENT = """
    import multiprocessing
    from tca_module import connect

    def child():
        with connect("child", patience=5.0) as user:
            print(*sorted(module.name for module in user.modules()), flush=True)

    with connect("parent") as user:
        user.modules()
        one = multiprocessing.get_context("fork").Process(target=child)
        one.start()
        one.join()
        print(*(module.name for module in user.modules()), flush=True)
"""


def test_forked_child_gets_a_connection_of_its_own(tmp_path: Path) -> None:
    """ZeroMQ's threads do not survive a fork, so the child must not use its parent's context."""
    with central(tmp_path) as daemon, program(PARENT, daemon.address) as parent:
        output, errors = parent.communicate(timeout=60)
        assert output.splitlines() == ["child parent", "parent"], errors


WORK, UNHEARD = Command("work", int), Command("unheard of", int)
LEVEL, HEIGHT, WHERE = Variable("level", int), Variable("height", int), Query("where", reply=int)


def set_and_get(user: Client, level: int) -> int:
    user.set_variable(LEVEL, level)
    return user.get_variable(LEVEL)


CALLS: dict[str, tuple[Callable[[Client], Any], Any]] = {
    "tasks": (lambda user: user.tasks(), []),
    "modules": (lambda user: "user" in [module.name for module in user.modules()], True),
    "handlers": (lambda user: user.handlers(WORK), []),
    "status": (lambda user: user.status()["tasks"], 0),
    "variable": (lambda user: user.get_variable(LEVEL, 7), 7),
    "declared": (lambda user: user.declared("work").name, "work"),
    "command": (lambda user: user.command(WORK, 2).id, 1),
    "command of another message": (lambda user: user.command(UNHEARD, 2).id, 2),
    "set a variable": (lambda user: set_and_get(user, 3), 3),
    "swap a variable": (lambda user: user.swap_variable(HEIGHT, 3), None),
    "ask": (lambda user: user.execute_if_handled(WHERE), None),
}


def test_first_call_after_central_restart_keeps_client_state(tmp_path: Path) -> None:
    """Each call is the first one of its client after the restart."""
    with ExitStack() as stack:
        first = stack.enter_context(central(tmp_path))
        users = {call: stack.enter_context(connect("user", first.address)) for call in CALLS}
        for user in users.values():
            user.command(WORK, 1)
            user.set_variable(LEVEL, 1)
            user.set_variable(HEIGHT, 1)
        first.kill()
        stack.enter_context(central(tmp_path / "again", bind=first.address))
        found = {call: CALLS[call][0](user) for call, user in users.items()}
        assert found == {call: expected for call, (_, expected) in CALLS.items()}
