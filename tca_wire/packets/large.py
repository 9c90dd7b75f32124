"""Bodies with large data: the body names a *segment* of shared memory that holds the data.

A large body is ``0xC1`` (a byte that MessagePack never uses) and a MessagePack array, the Handle.
Its ``data`` are MessagePack like an ordinary body, but arrays and values of LARGE bytes and more
are references into the segment (tca_wire/messages/arrays.py). Between programs that share no memory
the bytes of the segment follow the handle, and ``segment`` is "". decision 125 has the rules.
"""

import re
from enum import IntFlag

import msgspec

from tca_wire.errors import ProtocolError
from tca_wire.vocabulary import Limit

LARGE = 64 << 10
"""Data of this many bytes and more do not pass through central, if the memory is shared."""

MARK = b"\xc1"
ALIGNMENT = 64
"""Parts of a segment begin at a multiple of this many bytes, as numpy and vector units like it."""

DATA_FOLDER, HELD_FOLDER = "data", "held"
"""Folders beside a journal with copies of segments: data/EPOCH/SEGMENT has those of the journal."""

_SEGMENT = re.compile(r"[0-9a-f]{1,32}/[0-9]{1,18}")
"""A segment's name: the incarnation of the module that made it, and a number."""


class Keep(IntFlag):
    """Why the bytes of a segment are also written to the disk."""

    NOTHING = 0
    TASK = 1  # of a goal, command or variable: until central releases it
    JOURNAL = 2  # for replay and export: as long as the journal


class Handle(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The beginning of a large body."""

    segment: str
    """The name of the segment; "": its bytes follow in the body."""
    size: int
    """The bytes of the segment that are used."""
    keep: int
    data: bytes
    """The data, with references into the segment."""


_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(Handle).decode


class LargeBody(bytes):
    """A large body, and what this process knows about its segment.

    An object of a user of this class may be kept alive by the body, and freed with it.
    """

    owner: object = None
    held: int = 0
    """The result of ``held_size``, if it is known: the handle is then sound."""


def is_large(body: bytes) -> bool:
    """Whether a body has its data in a segment, or in bytes that follow its handle."""
    return body[:1] == MARK


def pack_handle(handle: Handle) -> bytes:
    """Return the body of a handle; the bytes of a segment without a name must follow."""
    return MARK + len(encoded := _encode(handle)).to_bytes(4, "big") + encoded


def unpack_handle(body: bytes) -> tuple[Handle, memoryview]:
    """Return the handle of a large body, and the bytes that follow it.

    Raises ProtocolError if it is damaged.
    """
    try:
        end = 5 + int.from_bytes(body[1:5], "big")
        handle = _decode(body[5:end])
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(f"a large body is damaged: {error}") from None
    rest = memoryview(body)[end:]
    is_sound = _SEGMENT.fullmatch(handle.segment) if handle.segment else len(rest) == handle.size
    if not is_sound or (handle.segment and rest) or not 0 < handle.size <= Limit.LARGE:
        raise ProtocolError(f"a large body is damaged: segment {handle.segment!r:.60}")
    return handle, rest


def damage_of(body: bytes) -> str:
    """Return why a large body can't be used, or ""."""
    if isinstance(body, LargeBody) and body.held:
        return ""
    try:
        unpack_handle(body)
    except ProtocolError as error:
        return str(error)
    return ""


def held_size(body: bytes) -> int:
    """Return the bytes that a body holds in memory, with those of its segment."""
    if body[:1] != MARK:
        return len(body)
    if isinstance(body, LargeBody) and body.held:
        return body.held
    try:
        handle, rest = unpack_handle(body)
    except ProtocolError:
        return len(body)
    return len(body) + handle.size - len(rest)
