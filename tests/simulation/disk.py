"""A file as a crash leaves it: what was written survives a kill, what was synced survives a power cut."""

import random
from io import BytesIO

import msgspec

from tca_central.events import Input
from tca_wire.journal.frames import framed, payloads


class SimulatedFile:
    """Bytes that are written, and how many of them are safe."""

    def __init__(self) -> None:
        self.content = bytearray()
        self.synced = 0
        self.writes = 0

    def write(self, some: bytes | bytearray) -> None:
        self.content += some
        self.writes += 1

    def sync(self) -> None:
        self.synced = len(self.content)

    def cut_power(self, dice: random.Random) -> None:
        """Of what was not synced some is there, to any byte; perhaps with zeros after it."""
        kept = dice.randint(self.synced, len(self.content))
        zeros = dice.randint(0, 40) if dice.random() < 0.3 else 0
        self.content[kept:] = bytes(zeros)
        self.sync()


def as_record(given: Input) -> bytes:
    """An input as the log has it."""
    return framed(_encode(given))


def inputs_in(content: bytes | bytearray) -> tuple[list[Input], int]:
    """The inputs that are there whole, and how many bytes they take."""
    records = list(payloads(BytesIO(content)))
    return [_decode(payload) for _, payload in records], records[-1][0] if records else 0


_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(Input).decode
