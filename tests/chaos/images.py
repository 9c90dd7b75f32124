"""Programs that exchange images and informs all the time, for tests that kill them.

Each image has its sender, its number and its checksum in its first bytes, so that a receiver knows
that it sees one whole image. Receivers keep some views, and check them again later.
"""

import logging
import os
import signal
import sys
import time
import zlib
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from chaos.robot import PATIENCE, Notebook
from numpy.typing import NDArray

from tca_central.__main__ import central
from tca_central.shell import images, store
from tca_module import (
    BadData,
    Broadcast,
    Callback,
    Client,
    Command,
    Inform,
    Module,
    NotSent,
    Query,
    QueryFailed,
    Refused,
    SentTask,
    Task,
    TaskFailed,
    Variable,
    connect,
)

log = logging.getLogger(__name__)

Image = NDArray[np.uint8]
FRAME = Broadcast("frame", Image)
NOTE = Inform("note", tuple[int, int])
LOOK = Query("look", Image, reply=Image)
GRASP = Command("grasp", Image, result=Image)
MAP = Variable("map", Image)

MOST_OPEN = 4  # commands of the client that it has not waited for
VIEWS = 6  # that each receiver keeps
_HEAD = 3 * 8  # bytes: sender, number, checksum


def image(number: int, size: int) -> Image:
    """Return an image of this process."""
    pattern = np.arange(number % 241, number % 241 + 251, dtype=np.uint8)
    made = np.resize(pattern, size)
    made[:_HEAD].view(np.int64)[:2] = os.getpid(), number
    made[16:_HEAD].view(np.int64)[0] = _checksum(made)
    return made


def _checksum(found: Image) -> int:
    return zlib.crc32(found[_HEAD:].data, zlib.crc32(found[:16].data))


class Eyes:
    """Checks images, when they arrive and when they are no longer kept."""

    def __init__(self, notebook: Notebook) -> None:
        self._notebook = notebook
        self._kept = deque[tuple[Image, int]]()

    def see(self, found: Image) -> tuple[int, int]:
        """Return the sender and the number of an image."""
        checksum = self._check(found)
        self._kept.append((found, checksum))
        if len(self._kept) > VIEWS:
            older, expected = self._kept.popleft()
            if self._check(older) != expected:
                self._notebook.note("wrong", "a view has changed")
        sender, number = found[:16].view(np.int64)
        return int(sender), int(number)

    def _check(self, found: Image) -> int:
        checksum = int(found[16:_HEAD].view(np.int64)[0])
        if checksum != _checksum(found) or found.flags.writeable:
            self._notebook.note("wrong", "an image is damaged", found[:_HEAD].tobytes().hex())
        return checksum


# --- modules --------------------------------------------------------------------------------------


def camera(notebook: Notebook, size: int) -> Module:
    """Return the module that broadcasts images."""
    module, numbers = Module("camera"), count()

    @module.every(1 / 30)
    def shoot(callback: Callback) -> None:
        callback.broadcast(FRAME, image(next(numbers), size))

    return module


def subscriber(notebook: Notebook, size: int, name: str) -> Module:
    """Return a module that gets the newest images, and is sometimes slow."""
    module, eyes, random = Module(name), Eyes(notebook), Random(os.getpid())

    @module.handles(FRAME, pending=1)
    def watch(_: Task, found: Image) -> None:
        notebook.note("heard", "frame", *eyes.see(found))
        time.sleep(0.1 * random.random() ** 4)

    return module


def arm(notebook: Notebook, size: int) -> Module:
    """Return the module that carries out commands. Some take longer than it takes to copy them."""
    module, eyes = Module("arm"), Eyes(notebook)

    @module.handles(GRASP)
    def grasp(task: Task, found: Image) -> Image:
        _, number = eyes.see(found)
        notebook.note("begin", task.id)
        time.sleep(0.7 if number % 12 == 5 else 0.005)
        notebook.note("end", task.id)
        return image(number, size)

    return module


def ear(notebook: Notebook, size: int) -> Module:
    """Return the module that hears informs and answers queries."""
    module, eyes = Module("ear"), Eyes(notebook)

    @module.handles(NOTE)
    def note(_: Task, data: tuple[int, int]) -> None:
        notebook.note("heard", "note", *data)

    @module.handles(LOOK)
    def look(_: Task, found: Image) -> Image:
        return image(eyes.see(found)[1], size)

    return module


MODULES: dict[str, Callable[[Notebook, int], Module]] = {
    "camera": camera,
    **{name: partial(subscriber, name=name) for name in ("s1", "s2", "s3")},
    "arm": arm,
    "ear": ear,
}


def be_central(folder: str) -> None:
    """Run ``tca central``, with frequent images of its state, and a short wait for lost requests."""
    images.EVENTS_BETWEEN, store.ORPHANED = 2000, 3.0
    central(["--journal", f"{folder}/journal"], prog_name="tca central")


def run(name: str, size: int, seed: int, folder: str) -> None:
    """Run a module or a client until it is terminated."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    logging.basicConfig(format="%(asctime)s %(process)d %(message)s", level=logging.INFO)
    notebook = Notebook(Path(folder), name)
    if name in MODULES:
        with suppress(NotSent):  # it was ended soon after a crash of central: the log says how many
            MODULES[name](notebook, size).run(patience=PATIENCE)
    else:
        Sender(name, notebook, size, seed).live()


# --- clients --------------------------------------------------------------------------------------


class Sender:
    """A client: "talker" sends bursts of informs, the other one commands. Both send queries."""

    def __init__(self, name: str, notebook: Notebook, size: int, seed: int) -> None:
        self.name, self.notebook, self.size = name, notebook, size
        self.random, self.eyes, self.numbers = Random(seed), Eyes(notebook), count()
        self.told, self.is_ending = count(), False
        self.open: deque[tuple[int, SentTask[Any]]] = deque()
        signal.signal(signal.SIGTERM, self._end)

    def _end(self, *_: object) -> None:
        self.is_ending = True

    def live(self) -> None:
        """Send until a regular end; then wait for all commands."""
        deeds = [self.ask, self.tell] if self.name == "talker" else [self.command] * 3
        try:
            with connect(self.name, patience=PATIENCE, linger=60, on_leave="keep") as user:
                while not self.is_ending:
                    with suppress(Refused, BadData):  # the memory is full, or was lost
                        self.random.choice([*deeds, self.ask, self.set])(user)
                while self.open:
                    self.await_oldest()
        except NotSent as error:
            self.notebook.note("not sent", error.number)
        self.notebook.note("over")

    def tell(self, user: Client) -> None:
        """Send informs as fast as possible."""
        for _ in range(self.random.randrange(300)):
            user.inform(NOTE, (os.getpid(), next(self.told)))

    def ask(self, user: Client) -> None:
        """Send a query."""
        asked = image(number := next(self.numbers), self.size)
        self._await(number, lambda: user.query(LOOK, asked, timeout=None))

    def set(self, user: Client) -> None:
        """Set a variable that others set, too, and read it."""
        user.set_variable(MAP, image(next(self.numbers), self.size))
        self.eyes.see(user.get_variable(MAP))

    def command(self, user: Client) -> None:
        """Send a command, which runs beside the earlier ones."""
        number = next(self.numbers)
        sent = user.command(GRASP, image(number, self.size), sequential=False)
        self.open.append((number, sent))
        if len(self.open) > self.random.randrange(MOST_OPEN):
            self.await_oldest()

    def await_oldest(self) -> None:
        """Wait for the oldest command."""
        number, sent = self.open.popleft()
        self._await(number, sent.result, sent)

    def _await(
        self, number: int, wait: Callable[[], Image], sent: SentTask[Any] | None = None
    ) -> None:
        """Note a wait, and its outcome: done, or the name of a failure."""
        self.notebook.note("awaits", number)
        try:
            if (found := self.eyes.see(wait())[1]) != number:
                self.notebook.note("wrong", f"the answer to {number} is {found}")
            outcome = "done"
        except (QueryFailed, TaskFailed) as error:
            outcome = error.failure
            log.info("%d: %s", number, error)
        except Refused as error:
            outcome = error.refusal
        except BadData:  # the memory was lost
            outcome = "bad data"
        task = 0 if sent is None else sent.id
        self.notebook.note("outcome", number, task, "query" if sent is None else "task", outcome)
