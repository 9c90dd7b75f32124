"""Informs that share packets, over real sockets: none is late, lost, doubled or out of order."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from integration.commanded import SOON
from module.real_central import until
from processes import Central, central, program

from tca_module import Callback, Command, Inform, Module, Query, Task, connect
from tca_wire.journal.facts import Received

pytestmark = pytest.mark.slow
COUNT = 200
NOTE, HEARD = Inform("note", int), Query("heard", reply=list[int])
TALK = Command("talk", int)


class Ear:
    """A module that stores what it hears."""

    def __init__(self, address: str) -> None:
        self.heard: list[int] = []
        self.module = Module("ear", address)
        self.module.handles(NOTE)(lambda _, number: self.heard.append(number))
        self.module.handles(HEARD)(lambda _: self.heard)

    def hears(self, *numbers: int) -> bool:
        """Compute, without a call of the library, until all numbers are heard, or for long."""
        end = time.monotonic() + SOON
        while self.heard != list(numbers) and time.monotonic() < end:
            sum(range(100))
        return self.heard == list(numbers)


@pytest.fixture
def ear(address: str) -> Ear:
    return Ear(address)


def test_informs_leave_while_their_sender_computes(ear: Ear, address: str) -> None:
    with ear.module.running(), connect("user", address) as user:
        user.inform(NOTE, 1)
        user.inform(NOTE, 2)
        assert ear.hears(1, 2)


def test_informs_leave_while_their_handler_computes(ear: Ear, address: str) -> None:
    mouth, found = Module("mouth", address), list[bool]()

    @mouth.handles(TALK)
    def talk(task: Task, number: int) -> None:
        for one in range(number):
            task.inform(NOTE, one)
        found.append(ear.hears(*range(number)))

    with ear.module.running(), mouth.running(), connect("user", address) as user:
        user.command(TALK, 3).wait(SOON)
    assert found == [True]


def test_informs_leave_while_a_callback_computes(ear: Ear, address: str) -> None:
    mouth, found = Module("mouth", address), list[bool]()

    @mouth.every(0.01)
    def talk(callback: Callback) -> None:
        if not found:
            callback.inform(NOTE, 1)
            callback.inform(NOTE, 2)
            found.append(ear.hears(1, 2))

    with ear.module.running(), mouth.running():
        until(lambda: found, "the callback has returned")
    assert found == [True]


def test_queries_and_tasks_keep_their_place(ear: Ear, address: str) -> None:
    mouth = Module("mouth", address)
    mouth.handles(TALK)(lambda task, number: task.inform(NOTE, number))
    with ear.module.running(), mouth.running(), connect("user", address) as user:
        pending = []
        for number in range(COUNT):
            user.inform(NOTE, number)
            pending.append(user.query_send(HEARD))
        for number, reply in enumerate(pending):
            assert reply.receive() == list(range(number + 1))
        user.command(TALK, COUNT).wait(SOON)
        assert user.query(HEARD) == list(range(COUNT + 1))


def test_each_thread_keeps_its_order(ear: Ear, address: str) -> None:
    with ear.module.running(), connect("user", address, threads=True) as user:

        def talk(first: int) -> None:
            for number in range(COUNT):
                user.inform(NOTE, first + number)

        threads = [threading.Thread(target=talk, args=(1000 * one,)) for one in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        until(lambda: len(ear.heard) == 3 * COUNT, "all informs are heard")
    for first in (0, 1000, 2000):
        mine = [number for number in ear.heard if first <= number < first + 1000]
        assert mine == list(range(first, first + COUNT))


def test_forked_child_sends_nothing_of_its_parent(ear: Ear, address: str) -> None:
    with ear.module.running(), connect("user", address) as user:
        for number in range(COUNT):
            user.inform(NOTE, number)
            if number % 50 == 3:
                child = os.fork()
                if not child:
                    time.sleep(0.01)  # longer than an inform may wait
                    os._exit(0)
                os.waitpid(child, 0)
        assert user.query(HEARD) == list(range(COUNT))


ENDS = {
    "return": "",
    "exit": "sys.exit(3)",
    "error": "raise ValueError",
    "end of block": "user.close()",
}

SENDER = """
    import sys
    from tca_module import Inform, connect

    note = Inform("note", int)
    user = connect("sender")
    for number in range({count}):
        user.inform(note, number)
    {end}
"""

STREAMER = """
    from tca_module import Inform, Module

    note, sent = Inform("note", int), []
    module = Module("sender")

    @module.every(0.01)
    def stream(callback):
        if not sent:
            for number in range({count}):
                callback.inform(note, number)
            sent.append(True)
            print("sent", flush=True)

    module.run()
"""


def numbers_received(running: Central) -> list[int]:
    """Stop central, and return the numbers in the informs that it received."""
    running.stop()
    return [fact.body[-1] for fact in running.facts(Received) if fact.message == "note"]


@pytest.mark.parametrize("end", ENDS)
def test_end_of_program_loses_no_informs(tmp_path: Path, end: str) -> None:
    with central(tmp_path) as running:
        text = SENDER.format(count=COUNT, end=ENDS[end])
        with program(text, running.address) as sender:
            sender.communicate()
        assert numbers_received(running) == list(range(COUNT))


def test_terminated_module_loses_no_informs(tmp_path: Path) -> None:
    with central(tmp_path) as running:
        with program(STREAMER.format(count=COUNT), running.address) as module:
            module.hear("sent")
            module.send_signal(signal.SIGTERM)
            module.communicate()
        assert numbers_received(running) == list(range(COUNT))
