"""Processes that are stopped but live. A stopped module counts as lost; a stopped central loses no
module.
"""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq
from module.real_central import until
from processes import Central, central, program

from tca_module import (
    CentralLost,
    Command,
    Module,
    MultiQuery,
    Outcome,
    Query,
    TaskFailed,
    Timeout,
    Variable,
    connect,
)
from tca_wire.journal import facts
from tca_wire.packets import codec, headers

STEP, LOOK, LOAD = Command("step"), Query("look", reply=str), Command("load", float)
VIEWS = MultiQuery("views", reply=str)
SOON = 30.0

LEGS = """
    import time
    from tca_module import Command, Module, Task
    legs = Module("legs")

    @legs.handles(Command("step"))
    def step(task: Task) -> None:
        with task.lock("camera"):
            print("steps", flush=True)
            while not task.cancelled:
                time.sleep(0.02)
            print("was told", flush=True)

    legs.run()
"""
CLIENT = """
    import sys
    from tca_module import connect
    user = connect("user")
    user.lock("camera")
    print("has it", flush=True)
    sys.stdin.read()
"""
LOADER = """
    import ctypes
    from tca_module import Command, Module, Task
    planner = Module("planner")

    @planner.handles(Command("load", float))
    def load(_: Task, seconds: float) -> None:
        ctypes.PyDLL(None).sleep(int(seconds))  # a PyDLL keeps Python's lock, as loading a model may

    planner.run()
"""
PARENT = """
    import os, time
    from tca_module import Module
    with Module("parent").running():
        if (child := os.fork()) == 0:
            time.sleep(60)
            os._exit(0)
        print(child, flush=True)
        time.sleep(60)
"""


def make_eyes(address: str) -> Module:
    eyes = Module("eyes", address)
    eyes.resource("camera")
    eyes.handles(LOOK)(lambda _: "clear")
    eyes.handles(Command("photo"), resource="camera")(lambda _: None)
    return eyes


def modules_lost_for_silence(daemon: Central) -> list[str]:
    """Return the modules that were lost for their silence, according to the journal."""
    return [fact.module for fact in daemon.facts(facts.ModuleLeft) if "silent" in fact.why]


TCP = "tcp://127.0.0.1:*"


@contextmanager
def running(folder: Path, *options: str, bind: str = "") -> Iterator[tuple[Central, str]]:
    """Run a central. Yield it with the address where it listens."""
    with central(folder, *options, bind=bind) as daemon:
        yield daemon, daemon.first_line.removeprefix("central: listening on ")


def check_module_lost_and_rejoined(
    folder: Path, seconds: int, *options: str, bind: str = ""
) -> None:
    """Stop a module while it handles a command. The module is lost, and serves again once it
    resumes.
    """
    why = f"its process was silent for {seconds} s"
    with running(folder, *options, bind=bind) as (daemon, address), make_eyes(address).running():
        with program(LEGS, address) as legs, connect("user", address) as user:
            user.wait_until_handled(STEP, timeout=SOON)
            step = user.command(STEP)
            legs.hear("steps")
            legs.send_signal(signal.SIGSTOP)
            with pytest.raises(TaskFailed, match=f"module lost: module 'legs' was lost: {why}"):
                step.result(timeout=SOON)
            user.lock("camera", timeout=SOON).release()
            assert user.query(LOOK, timeout=SOON) == "clear"
            assert {module.name for module in user.modules()} == {"user", "eyes"}
            legs.send_signal(signal.SIGCONT)
            legs.hear("was told")
            user.wait_until_handled(STEP, timeout=SOON)
            step = user.command(STEP)
            legs.hear("steps")
            step.kill()
            legs.hear("was told")
            assert step.wait(timeout=SOON) is Outcome.KILLED
            legs.terminate()
            late = f"the answer of step {{1}} came too late: the module had been lost ({why})\n"
            assert legs.communicate()[1] == late
        log = [
            line
            for line in daemon.stop().splitlines()
            if "refused" in line or "nothing done" in line
        ]
        assert log == [f"central: nothing done for module 'legs': {late.strip()}"]
        assert modules_lost_for_silence(daemon) == ["legs"]


def test_stopped_module_is_lost_and_rejoins_when_resumed(tmp_path: Path) -> None:
    check_module_lost_and_rejoined(tmp_path, 3, "--lost-after", "3")


@pytest.mark.soak
@pytest.mark.parametrize("bind", ["", TCP])
def test_stopped_module_is_lost_after_default_timeout(tmp_path: Path, bind: str) -> None:
    check_module_lost_and_rejoined(tmp_path, 5, bind=bind)


def test_stopped_script_loses_its_lock(tmp_path: Path) -> None:
    with central(tmp_path, "--lost-after", "3") as daemon, make_eyes(daemon.address).running():
        with program(CLIENT, daemon.address) as script, connect("other", daemon.address) as other:
            script.hear("has it")
            script.send_signal(signal.SIGSTOP)
            other.lock("camera", timeout=SOON).release()


@pytest.mark.soak
def test_client_without_first_heartbeat_is_lost(tmp_path: Path) -> None:
    """The client's hello arrives, but its heartbeat connection is never made."""
    with central(tmp_path, "--lost-after", "2") as daemon, connect("user", daemon.address) as user:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        with context, context.socket(zmq.DEALER) as early:
            early.linger = 0
            early.connect(daemon.address)
            early.send(
                codec.pack(
                    [(headers.Hello(1, headers.PROTOCOL_VERSION, "early", "1", pulse=b"none"), b"")]
                )
            )
            until(
                lambda: {module.name for module in user.modules()} == {"user", "early"},
                "it is there",
            )
            until(
                lambda: {module.name for module in user.modules()} == {"user"}, "it is lost", SOON
            )
        daemon.stop()
        assert modules_lost_for_silence(daemon) == ["early"]


@pytest.mark.soak
def test_handler_holding_the_gil_is_not_lost(tmp_path: Path) -> None:
    with central(tmp_path) as daemon:
        with program(LOADER, daemon.address), connect("user", daemon.address) as user:
            user.wait_until_handled(LOAD, timeout=SOON)
            assert user.command(LOAD, 8.0).wait(timeout=SOON) is Outcome.DONE
        daemon.stop()
        assert modules_lost_for_silence(daemon) == []


@pytest.mark.soak
def test_resumed_module_does_not_report_central_silent(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, make_eyes(daemon.address).running():
        with program(LEGS, daemon.address) as legs, connect("user", daemon.address) as user:
            user.wait_until_handled(STEP, timeout=SOON)
            user.command(STEP)
            legs.hear("steps")
            legs.send_signal(signal.SIGSTOP)
            threading.Event().wait(12)  # longer than any patience
            legs.send_signal(signal.SIGCONT)
            legs.hear("was told")
            user.wait_until_handled(STEP, timeout=SOON)
            legs.terminate()
            assert "does not answer" not in legs.communicate()[1]


@pytest.mark.soak
@pytest.mark.parametrize("bind", ["", TCP])
def test_resumed_central_loses_no_module(tmp_path: Path, bind: str) -> None:
    with running(tmp_path, "--lost-after", "2", bind=bind) as (daemon, address):
        with make_eyes(address).running(), program(LEGS, address) as legs:
            with connect("user", address, patience=3.0) as user:
                user.wait_until_handled(STEP, timeout=SOON)
                step = user.command(STEP)
                legs.hear("steps")
                daemon.signal(signal.SIGSTOP)
                with pytest.raises(CentralLost):
                    user.query(LOOK)
                threading.Event().wait(6)
                daemon.signal(signal.SIGCONT)
                assert user.query(LOOK, timeout=SOON) == "clear"
                with pytest.raises(Timeout):
                    step.wait(timeout=4.5)  # long enough to notice a silence
                step.kill()
                assert step.wait(timeout=SOON) is Outcome.KILLED
        daemon.stop()
        assert modules_lost_for_silence(daemon) == []


@pytest.mark.soak
def test_stopped_module_is_never_lost_when_lost_after_is_0(tmp_path: Path) -> None:
    with central(tmp_path, "--lost-after", "0") as daemon, make_eyes(daemon.address).running():
        with program(LEGS, daemon.address) as legs, connect("user", daemon.address) as user:
            user.wait_until_handled(STEP, timeout=SOON)
            step = user.command(STEP)
            legs.hear("steps")
            legs.send_signal(signal.SIGSTOP)
            with pytest.raises(Timeout):
                step.wait(timeout=7)
            legs.send_signal(signal.SIGCONT)
            step.kill()
            legs.hear("was told")
            assert step.wait(timeout=SOON) is Outcome.KILLED


@pytest.mark.soak
def test_killed_module_is_lost_though_child_keeps_its_sockets(tmp_path: Path) -> None:
    """The kernel closes sockets only when the last process that has them ends. The child sends no
    heartbeats.
    """
    with central(tmp_path, "--lost-after", "3") as daemon, connect("user", daemon.address) as user:
        with program(PARENT, daemon.address) as parent:
            child = int(parent.stdout.readline())
            try:
                parent.kill()
                until(
                    lambda: {module.name for module in user.modules()} == {"user"},
                    "the parent is lost",
                )
            finally:
                os.kill(child, signal.SIGKILL)
        daemon.stop()
        assert modules_lost_for_silence(daemon) == ["parent"]


def test_timeout_holds_at_first_use_of_a_message(tmp_path: Path) -> None:
    """The stopped central does not know the message yet."""
    with central(tmp_path) as daemon, connect("user", daemon.address) as user:
        daemon.signal(signal.SIGSTOP)
        with pytest.raises(Timeout, match=r"query 'look' was not answered within 0.5 s"):
            user.query(LOOK, timeout=0.5)
        assert user.multi_query(VIEWS, timeout=0.5) == []
        with pytest.raises(Timeout, match=r"the wait for handlers was not over within 0.5 s: "):
            user.wait_until_handled(STEP, timeout=0.5)
        daemon.signal(signal.SIGCONT)
        user.modules()
        with make_eyes(daemon.address).running():
            assert user.query(LOOK, timeout=SOON) == "clear"
        assert user.handlers(STEP) == []
        daemon.signal(signal.SIGSTOP)
        with pytest.raises(
            Timeout, match=r"not all handled within 0.1 s: query 'look', command 'step'"
        ):
            user.wait_until_handled(LOOK, STEP, timeout=0.1)  # central knows these
        daemon.signal(signal.SIGCONT)


def test_stopped_central_is_distinguished_from_absent_one(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, connect("user", daemon.address, patience=0.5) as user:
        daemon.signal(signal.SIGSTOP)
        stands_still = "does not answer: it accepts connections, but its process is stopped"
        with pytest.raises(CentralLost, match=stands_still):
            user.modules()
        with pytest.raises(CentralLost, match=stands_still):
            connect("other", daemon.address, patience=0.5)
        daemon.signal(signal.SIGCONT)
        daemon.stop()
        with pytest.raises(CentralLost, match="does not answer: start it with 'tca central'"):
            connect("other", daemon.address, patience=0.5)


REST, POSE = Command("rest"), Variable("pose", int)


def test_abandoned_command_is_killed_when_central_resumes(
    tmp_path: Path,
) -> None:
    with central(tmp_path) as daemon, connect("user", daemon.address, patience=1.0) as user:
        user.set_variable(POSE, 1)
        user.command(REST).kill()
        daemon.signal(signal.SIGSTOP)
        with pytest.raises(
            CentralLost,
            match="command 'rest' is killed as soon as central answers, if central received",
        ):
            user.command(REST).wait()
        with pytest.raises(
            CentralLost,
            match="setting variable 'pose' may still be carried out, if central received it",
        ):
            user.set_variable(POSE, 2)
        daemon.signal(signal.SIGCONT)
        assert user.get_variable(POSE) == 2
        assert user.tasks() == []
        wanted = user.command(REST)
        assert [task.id for task in user.tasks()] == [wanted.id]
        wanted.kill()
        assert wanted.wait(5) is Outcome.KILLED
        daemon.stop()
        killed = daemon.facts(facts.Killed)
    assert [(fact.by, bool(fact.why)) for fact in killed] == [
        ("user", False),
        ("user", True),
        ("user", False),
    ]
