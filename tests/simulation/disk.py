"""A file as a crash leaves it: what was written survives a kill, what was synced survives a power cut."""

import random
import struct
import zlib

import msgspec

_HEAD = struct.Struct(">II")


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


class Input(msgspec.Struct, array_like=True):
    """What central was given: what *kind*, when, by which connection, and the bytes."""

    kind: str
    time: float
    connection: bytes = b""
    packet: bytes = b""


_decode = msgspec.msgpack.Decoder(Input).decode


def framed(given: Input) -> bytes:
    """An input as the log has it."""
    payload = msgspec.msgpack.encode(given)
    return _HEAD.pack(len(payload), zlib.crc32(payload)) + payload


def inputs_in(content: bytes | bytearray) -> tuple[list[Input], int]:
    """The inputs that are there whole, and how many bytes they take."""
    found, at = [], 0
    while at + _HEAD.size <= len(content):
        size, checksum = _HEAD.unpack_from(content, at)
        payload = bytes(content[at + _HEAD.size : at + _HEAD.size + size])
        if not size or len(payload) < size or zlib.crc32(payload) != checksum:
            break
        found.append(_decode(payload))
        at += _HEAD.size + size
    return found, at
