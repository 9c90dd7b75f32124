"""A handler that hangs is left behind. Another thread replaces it; its late reply is ignored."""

import threading
from pathlib import Path

import pytest
from module.real_central import SOON, RealCentral, until

from tca_module import Command, Module, Query, Task, Timeout, connect

STEP, LOOK = Command("step", int), Query("look", int, reply=int)


def test_hung_handler_is_replaced_by_other_thread(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    legs = Module("legs", central := f"ipc://{tmp_path}/central.sock")
    legs.resource("legs", hung="replace", hung_after=0.2)
    hangs, go_on, done = threading.Event(), threading.Event(), list[int]()

    @legs.handles(STEP)
    def step(_: Task, number: int) -> None:
        if not number:
            hangs.set()
            go_on.wait(SOON)
        done.append(number)

    @legs.handles(LOOK)
    def answer_query(_: Task, number: int) -> int:
        if not number:
            go_on.wait(SOON)
        return number

    with RealCentral(central), legs.running(), connect("user", central) as user:
        first = user.command(STEP, 0)
        second = user.command(STEP, 1)
        assert hangs.wait(SOON)
        first.kill()
        second.wait(timeout=SOON)
        assert done == [1]
        with pytest.raises(Timeout):
            user.query(LOOK, 0, timeout=0.1)
        assert user.query(LOOK, 7, timeout=SOON) == 7
        assert legs._slots.left_behind == 2
        go_on.set()
        until(
            lambda: caplog.text.count("has returned after all") == 2,
            "those left behind have returned",
        )
        assert user.query(LOOK, 8, timeout=SOON) == 8
    assert caplog.text.count("another thread takes its place") == 2
    assert "Traceback" not in caplog.text
