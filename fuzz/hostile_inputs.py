"""Logs of inputs that somebody else has written, as ``tca check --rerun`` gets them: a CentralError at most."""

import contextlib
import logging
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from fuzz.choices import Choices
from fuzz.grammar import Grammar, damaged
from fuzz.hostile_central import LINES, beginning
from tca_central.errors import CentralError
from tca_central.events import Arrived, ConnectionId, Input
from tca_central.shell.input_log import INPUT_VERSION, Ended, Head
from tca_central.shell.log_writer import Sync
from tca_central.shell.replaying import InputReplay, has_ended, newest_run
from tca_wire.journal.frames import framed

MOST_INPUTS = 30
_KINDS: tuple[Any, ...] = (*Input.__args__, Ended)


def _segment(choices: Choices, *, is_first: bool) -> bytes:
    encode = msgspec.msgpack.Encoder().encode
    grammar = Grammar(choices, {"time": lambda: (1.0, 2.0, 50.0), "connection": lambda: LINES, "index": lambda: (0, 1)})
    head = Head(INPUT_VERSION, "run", "0.1", is_first, Sync.BATCH, "boot", 0.0, 0.0)
    records = [head, *(Arrived(0.0, ConnectionId(line), packet) for line, packet in beginning())]
    records += [grammar.header(choices.one_of(_KINDS)) for _ in range(choices.below(MOST_INPUTS))]
    written = [framed(encode(one)) for one in records]
    if choices.is_one_in(3):
        place = choices.below(len(written))
        written[place] = damaged(written[place], choices)
    return b"".join(written)


@contextlib.contextmanager
def _silent(log: logging.Logger) -> Iterator[None]:
    """Images that can't be used are no news here."""
    log.disabled = True
    try:
        yield
    finally:
        log.disabled = False


def attack(data: bytes) -> None:
    """A folder of one or two segments."""
    choices = Choices(data)
    with _silent(logging.getLogger("tca.central")), tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in range(1, 2 + choices.below(2)):
            (folder / f"{number:08d}.tcai").write_bytes(_segment(choices, is_first=number == 1))
        with contextlib.suppress(CentralError):
            if segments := newest_run(folder):
                has_ended(segments)
                for _ in InputReplay(folder, segments, cuts=choices.is_one_in(2)).entries():
                    pass
