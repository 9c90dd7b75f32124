"""Foreign images of central's state. To decode one gives a central or an ImageError, nothing
else.
"""

import contextlib
import struct
import zlib
from typing import Any

import msgspec

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import damaged
from dev.fuzz.hostile_central import Attacked, beginning
from tca_central.core import Central
from tca_central.errors import ImageError
from tca_central.image.decoder import decode
from tca_central.image.encoder import encode

_CHECK = struct.Struct(">QI")
_VALUES: tuple[Any, ...] = (0, 1, -1, 1 << 60, None, "x", b"", [], 0.5, True)
_COUNT, _COLUMNS = 2, 3


def _image() -> bytes:
    attacked = Attacked()
    for line, packet in beginning():
        attacked.arrive(0.0, line, packet)
    return encode(attacked.central)


_TITLE, _, _REST = _image().partition(b"\n")


def attack(data: bytes) -> None:
    """Decode a real image with changes, mostly with a correct checksum."""
    choices = Choices(data)
    tables = msgspec.msgpack.decode(_REST[_CHECK.size :])
    for _ in range(1 + choices.below(4)):
        _change(tables, choices)
    content = msgspec.msgpack.encode(tables)
    content = damaged(content, choices) if choices.once_in(8) else content
    image = _TITLE + b"\n" + _CHECK.pack(len(content), zlib.crc32(content)) + content
    with contextlib.suppress(ImageError):
        assert isinstance(
            decode(damaged(image, choices) if choices.once_in(16) else image), Central
        )


def _change(tables: list[Any], choices: Choices) -> None:
    table = choices.one_of(tables)
    columns, kind = table[_COLUMNS], choices.below(8)
    if kind == 0:
        table[_COUNT] = choices.one_of((0, 1, table[_COUNT] + 1, 1 << 40))
    elif kind == 1 and columns:
        columns.pop(choices.below(len(columns)))
    elif kind == 2:
        tables.remove(table)
    elif columns:
        values = choices.one_of(columns)[0]
        place = choices.below(len(values) + 1)
        values[place : place + 1] = [choices.one_of(_VALUES)] * choices.below(3)
