"""The eight ends of a goal that actionlib tries its servers with, by goals of ROS and real processes."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import Process, central, program

from tca_module import ROS_GOAL, Client, Command, SentTask, TaskFailed, TaskKilled, connect

pytestmark = pytest.mark.slow
SOON = 30.0
DO = Command("do", str, result=str, life_cycle=ROS_GOAL)
SERVER = """
    import time
    from tca_module import ROS_GOAL, Command, Failure, LaterReply, Module, Task
    server = Module("server")

    @server.handles(Command("do", str, result=str, life_cycle=ROS_GOAL), takes=["cancel_goal"])
    def do(task: Task, case: str) -> str | LaterReply[str]:
        if case == "abort":
            raise Failure("abort")(text="the door is closed")
        if case == "raise an error":
            raise ValueError(case)
        if case == "drop":
            return task.reply_later()
        if case == "be preempted":
            for _ in task.requests():
                raise task.aborted()
        if case == "ignore a cancel":
            task.wait_for_request()
        if case == "wait":
            task.sleep(60)
        return "did it"

    server.run()
"""


@pytest.fixture
def server_and_user(tmp_path: Path) -> Iterator[tuple[Process, Client]]:
    with (
        central(tmp_path, "--lost-after", "3") as daemon,
        program(SERVER, daemon.address) as server,
        connect("user", daemon.address) as user,
    ):
        user.wait_until_handled(DO, timeout=SOON)
        yield server, user
        server.send_signal(signal.SIGCONT)
        server.kill()


def running(user: Client, case: str) -> SentTask[str]:
    task = user.command(DO, case)
    task.wait_for_state("executing", timeout=SOON)
    return task


def test_each_goal_ends_in_its_own_state(server_and_user: tuple[Process, Client]) -> None:
    _, user = server_and_user
    cases = {
        "succeed": ("succeeded", "did it"),
        "abort": ("aborted", "abort"),
        "be preempted": ("canceled", "killed"),
        "drop": ("aborted", "forgotten"),
        "raise an error": ("aborted", "handler error"),
        "ignore a cancel": ("succeeded", "did it"),
    }
    ends: dict[str, tuple[str, str]] = {}
    for case in cases:
        task = running(user, case)
        if case in ("be preempted", "ignore a cancel"):
            task.cancel()
        try:
            end = task.result(timeout=SOON)
        except TaskKilled:
            end = "killed"
        except TaskFailed as error:
            end = error.failure
        ends[case] = (task.state, end)
    assert ends == cases


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGSTOP], ids=["lose", "freeze"])
def test_goal_aborts_when_its_server_is_gone(
    signal_number: signal.Signals, server_and_user: tuple[Process, Client]
) -> None:
    server, user = server_and_user
    task = running(user, "wait")
    server.send_signal(signal_number)
    with pytest.raises(TaskFailed) as error:
        task.result(timeout=SOON)
    assert (task.state, error.value.failure) == ("aborted", "module lost")
