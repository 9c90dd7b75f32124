"""Foreign logs of inputs, as ``tca check --rerun`` reads them. Reading may raise only CentralError.

A central also starts on these logs, writes, and is killed, again and again. Each restart must
continue the run, whatever the ends of the files.
"""

import contextlib
import logging
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import Grammar, damaged
from dev.fuzz.hostile_central import LINES, beginning
from tca_central.errors import CentralError
from tca_central.events import Arrived, ConnectionId, Input, Record, Tick
from tca_central.inputs import events_of
from tca_central.shell.input_log import INPUT_SUFFIX, INPUT_VERSION, Ended, Head
from tca_central.shell.log_writer import Sync, numbers
from tca_central.shell.replaying import InputReplay, has_ended, newest_run
from tca_central.shell.run_folder import RunFolder
from tca_central.shell.run_log import RunLog
from tca_wire.journal.frames import framed
from tca_wire.journal.records import SEGMENT_SUFFIX
from tca_wire.packets.headers import PROTOCOL_VERSION

MOST_INPUTS, MOST_RESTARTS = 30, 3
_MEMORY = Path("/dev/shm")  # noqa: S108 - for speed only
_KINDS: tuple[Any, ...] = (*Input.__args__, Ended)


def _segment(choices: Choices, *, is_first: bool) -> bytes:
    encode = msgspec.msgpack.Encoder().encode
    grammar = Grammar(
        choices,
        {"time": lambda: (1.0, 2.0, 50.0), "connection": lambda: LINES, "index": lambda: (0, 1)},
    )
    head = Head(
        INPUT_VERSION, "run", "0.1", is_first, Sync.BATCH, "boot", 0.0, 0.0, PROTOCOL_VERSION
    )
    records = [head, *(Arrived(0.0, ConnectionId(line), packet) for line, packet in beginning())]
    records += [grammar.header(choices.one_of(_KINDS)) for _ in range(choices.below(MOST_INPUTS))]
    written = [framed(encode(one)) for one in records]
    if choices.once_in(3):
        place = choices.below(len(written))
        written[place] = damaged(written[place], choices)
    return b"".join(written)


@contextlib.contextmanager
def _silent(log: logging.Logger) -> Iterator[None]:
    """Silence the log: unusable images are expected here."""
    log.disabled = True
    try:
        yield
    finally:
        log.disabled = False


class Daemon:
    """Central with its logs, without connections."""

    def __init__(self, folder: Path, sync: Sync = Sync.ALWAYS, *, accept: bool = False) -> None:
        """Raises CentralError."""
        self.log: RunLog | None = None
        self.stopping = ""
        self._folder = RunFolder(folder, accept=accept)
        self.central, self.run = self._folder.central, self._folder.run
        try:
            self._folder.open(self, sync)
        except CentralError:
            self._folder.close()
            raise

    def handle_input(self, event: Input) -> None:
        """Let central handle an input."""
        assert self.log is not None
        self.log.add_input(event)
        for one in events_of(event):
            for effect in self.central.handle(one):
                if isinstance(effect, Record):
                    self.log.add_entry(effect.entry)

    def kill(self) -> None:
        """Leave all files as they are."""
        assert self.log is not None
        self.log.flush(self.central)
        self.log.end(self.central, "", is_over=False)
        self._folder.close()


def _live(folder: Path, choices: Choices) -> int:
    """Start, write, and be killed; return the number of the last event. Raises CentralError."""
    daemon = Daemon(folder)
    try:
        for line, packet in beginning()[: choices.below(4)]:
            daemon.handle_input(Arrived(daemon.central.clock.now, ConnectionId(line), packet))
    finally:
        daemon.kill()
    return daemon.central.event_count


def _leave_ends(folder: Path, choices: Choices) -> None:
    """Append torn records or zeros, and add files that a start on a full disk created."""
    torn = framed(msgspec.msgpack.encode(Tick(1.0)))
    for suffix in (INPUT_SUFFIX, SEGMENT_SUFFIX):
        newest = numbers(folder, suffix)[-1]
        end = choices.one_of(
            (b"", torn[:-1], torn[:3], bytes(choices.below(9) * 1000), b"\xce" + choices.take(30))
        )
        with (folder / f"{newest:08d}{suffix}").open("ab") as stream:
            stream.write(end)
        for number in range(choices.below(3)):
            (folder / f"{newest + 1 + number:08d}{suffix}").write_bytes(
                bytes(choices.below(2) * 50)
            )


def _restart(folder: Path, choices: Choices) -> None:
    """Check that after a successful start, no kill prevents a later start."""
    try:
        events = _live(folder, choices)
    except CentralError:
        return  # the inputs are damaged or meaningless
    for _ in range(MOST_RESTARTS):
        _leave_ends(folder, choices)
        before, events = events, _live(folder, choices)
        assert events > before, "an event was lost"


def attack(data: bytes) -> None:
    """Read a folder of one or two segments."""
    choices = Choices(data)
    place = _MEMORY if _MEMORY.is_dir() else None
    with _silent(logging.getLogger("tca.central")), tempfile.TemporaryDirectory(dir=place) as name:
        folder = Path(name)
        for number in range(1, 2 + choices.below(2)):
            (folder / f"{number:08d}.tcai").write_bytes(_segment(choices, is_first=number == 1))
        with contextlib.suppress(CentralError):
            if segments := newest_run(folder):
                has_ended(segments)
                for _ in InputReplay(folder, segments, cuts=choices.once_in(2)).entries():
                    pass
        _restart(folder, choices)
