"""Large data: values whose arrays stand beside their MessagePack, in the parts of a segment.

A sender encodes a value as LargeData. Its parts are the memory of the sender's arrays: the first
copy is made when the data are stored, in a segment or behind the handle. A receiver decodes an
OpenedBody, whose arrays are views of the segment.
"""

from collections.abc import Sequence
from typing import Any, Self

import msgspec

from tca_wire.errors import BadData, ProtocolError
from tca_wire.messages.arrays import PartOf, large_value, padded, slices_of, too_large
from tca_wire.packets.large import (
    ALIGNMENT,
    LARGE,
    MARK,
    Handle,
    Keep,
    LargeBody,
    is_large,
    pack_handle,
    unpack_handle,
)
from tca_wire.vocabulary import Limit

_WHOLE = 3  # MessagePack extension type: [offset, size] of the part with the encoded value
_NOWHERE = "0/0"  # the name of a segment that never exists
_decode_place = msgspec.msgpack.Decoder(tuple[int, int]).decode
_LONGEST_REFERENCE = 32  # bytes; a reference to the whole value is shorter


class LargeData(LargeBody):
    """An encoded value that no connection has stored yet. As bytes it is only the mark."""

    data: bytes
    parts: list[memoryview]
    size: int
    keep: Keep = Keep.NOTHING

    def __new__(cls, data: bytes, parts: Sequence[memoryview]) -> Self:
        """Create the body of a value: its MessagePack, and the parts to which it refers.

        MessagePack of LARGE bytes and more becomes a part, too. Raises BadData if a segment can't
        hold them.
        """
        self = super().__new__(cls, MARK)
        self.parts = list(parts)
        if len(data) >= LARGE:
            offset = size_of(self.parts, is_padded=True)
            self.parts.append(memoryview(data))
            data = _reference(offset, len(data))
        self.data, self.size = data, size_of(self.parts)
        if self.size > Limit.LARGE:
            raise BadData(too_large(self.size, Limit.LARGE))
        return self

    @classmethod
    def of_bytes(cls, value: bytes) -> Self:
        """Create the body of a value of LARGE bytes and more, without a copy of them.

        Their MessagePack begins with a header, which stands at the end of a part of its own. Raises
        what the constructor does, and OverflowError if MessagePack can't hold the bytes.
        """
        header = b"\xc6" + len(value).to_bytes(4, "big")
        before = ALIGNMENT - len(header)
        self = cls(b"", [memoryview(bytes(before) + header), memoryview(value)])
        self.data = _reference(before, len(header) + len(value))
        return self

    def __reduce__(self) -> Any:
        return bytes, (self.inline(),)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LargeData):
            return False
        return (self.data, self.keep, self.parts) == (other.data, other.keep, other.parts)

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self.data)

    def body(self, segment: str) -> bytes:
        """Return the handle of the data in a segment."""
        return pack_handle(Handle(segment, self.size, self.keep, self.data))

    def write(self, segment: memoryview) -> None:
        """Copy the parts into the memory of a segment."""
        at = 0
        for part in self.parts:
            at = padded(at)
            segment[at : at + len(part)] = part
            at += len(part)

    def inline(self) -> bytes:
        """Return the data as a body that holds them itself."""
        return self.body("") + self.content()

    def content(self) -> memoryview:
        """Return the bytes that a segment with these data has."""
        content = memoryview(bytearray(self.size))
        self.write(content)
        return content

    def part(self, offset: int, size: int) -> memoryview:
        """Return the bytes at an offset: a part, or a copy of bytes of several."""
        at = 0
        for part in self.parts:
            at = padded(at)
            if at == offset and size == len(part):
                return part
            at += len(part)
        return slices_of(self.content())(offset, size)


def size_of(parts: Sequence[memoryview], *, is_padded: bool = False) -> int:
    """Return the bytes of a segment with these parts. With *is_padded*, a part may follow."""
    size = 0
    for part in parts:
        size = padded(size) + len(part)
    return padded(size) if is_padded else size


class OpenedBody(LargeBody):
    """A large body with the memory of its segment; or with the *problem*, if it can't be read."""

    content: memoryview | None = None
    handle: Handle | None = None  #: its handle, if that was read already
    problem: str = "its data stand in shared memory that this program has not opened"

    def __reduce__(self) -> Any:
        return bytes, (bytes(self) if self.content is None else copy_of(self).inline(),)


def detached(data: LargeData) -> OpenedBody:
    """Return a body with a copy of the data in this process, to be stored later."""
    body = OpenedBody(data.body(_NOWHERE))
    body.content = data.content()
    return body


def copy_of(body: bytes) -> LargeData:
    """Return the data of a body, to store them once more. Raises BadData if they are gone."""
    handle, content = _opened(body)
    data = LargeData(handle.data, [content[: handle.size]])
    data.keep = Keep(handle.keep)
    return data


def inline(body: bytes) -> bytes:
    """Return a body that holds its data itself. Raises BadData if they are too large, or gone."""
    if isinstance(body, OpenedBody):
        body = copy_of(body)
    if isinstance(body, LargeData):
        body = body.inline()
    if len(body) > Limit.BODY:
        raise BadData(too_large(len(body), Limit.BODY))
    return body


def _opened(body: bytes) -> tuple[Handle, memoryview]:
    """Return a body's handle and the content of its segment. Raises BadData without either."""
    if isinstance(body, OpenedBody) and body.handle is not None and body.content is not None:
        return body.handle, body.content
    try:
        handle, content = unpack_handle(body)
    except ProtocolError as error:
        raise BadData(f"{error}") from None
    if not handle.segment:
        return handle, content
    if isinstance(body, OpenedBody) and body.content is not None:
        return handle, body.content
    raise BadData(body.problem if isinstance(body, OpenedBody) else OpenedBody.problem)


def why_unreadable(body: bytes) -> str:
    """Return why the data of a received body can't be read, whatever their type; or ""."""
    try:
        if is_large(body) and not isinstance(body, LargeData):
            _opened(body)
    except BadData as error:
        return f"{error}"
    return ""


def referred(body: bytes) -> tuple[bytes | memoryview, PartOf | None]:
    """Return the MessagePack of a large body, and the function that finds its parts.

    Raises BadData if the body is damaged, or its segment is gone.
    """
    part: PartOf
    if isinstance(body, LargeData):
        data, part = body.data, body.part
    else:
        handle, content = _opened(body)
        data, part = handle.data, slices_of(content)
    return (data if (whole := _whole(data)) is None else part(*whole)), part


def described(body: bytes) -> tuple[bytes | memoryview, PartOf | None]:
    """Return what ``referred`` does, for a reader that may lack the segment.

    Without the segment there is no function. A value that is one part is described by its size.
    """
    try:
        return referred(body)
    except BadData:
        try:
            data = unpack_handle(body)[0].data
        except ProtocolError as error:
            raise BadData(f"{error}") from None
        whole = _whole(data)
        return (data if whole is None else large_value(whole[1])), None


def _reference(offset: int, size: int) -> bytes:
    """Return MessagePack that refers to that of the whole value, in a segment."""
    place = msgspec.msgpack.encode((offset, size))
    return msgspec.msgpack.encode(msgspec.msgpack.Ext(_WHOLE, place))


def _whole(data: bytes) -> tuple[int, int] | None:
    """Return the part that holds the whole MessagePack, if it is in the segment.

    Raises msgspec's errors if the reference is damaged.
    """
    if len(data) > _LONGEST_REFERENCE:
        return None
    reference = msgspec.msgpack.decode(data)
    if not isinstance(reference, msgspec.msgpack.Ext) or reference.code != _WHOLE:
        return None
    return _decode_place(reference.data)
