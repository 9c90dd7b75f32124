"""Data that a format would silently leave out: fields of a subclass, misspelt keys of a dict.

A decoder passes over fields that its type does not have. So data to be sent is compared with what a receiver reads.
"""

import dataclasses
from typing import Any

import msgspec

from tca_wire.messages.arrays import without_content

_encode = msgspec.msgpack.Encoder(enc_hook=without_content).encode


def first_loss(sent: Any, read: Any) -> str:
    """Find the first part of a value that its receiver would not get.

    Args:
        sent: the sender's value.
        read: the same, as the receiver's type reads it.

    Returns:
        Its place, such as ``$.legs[2].hight``; "" if nothing is lost.
    """
    data = _encode(sent)
    return "" if data == _encode(read) else _loss(msgspec.msgpack.decode(data), read, "$")


def _loss(sent: Any, read: Any, path: str) -> str:
    """The first part of *sent*, plain data, that *read* does not have."""
    if isinstance(sent, dict):
        fields = _fields(read)
        if len(fields) == len(sent):  # keys of another type than text are read as such: compare them in their order
            fields = dict(zip(sent, fields.values(), strict=True)) if isinstance(read, dict) else fields
        for key, value in sent.items():
            if found := _loss(value, fields[key], f"{path}.{key}") if key in fields else f"{path}.{key}":
                return found
    elif isinstance(sent, list) and not isinstance(read, set | frozenset):
        items = read if isinstance(read, list | tuple) else list(_fields(read).values())
        for place, value in enumerate(sent):
            where = f"{path}[{place}]"
            if found := _loss(value, items[place], where) if place < len(items) else where:
                return found
    return ""


def _fields(read: Any) -> dict[Any, Any]:
    """The fields that a value has, by the names they travel with."""
    if isinstance(read, dict):
        return read
    if isinstance(read, msgspec.Struct):
        config = read.__struct_config__
        tag = {config.tag_field or "type": config.tag} if config.tag is not None else {}
        return tag | {one.encode_name: getattr(read, one.name) for one in msgspec.structs.fields(read)}
    fields = dataclasses.fields(read) if dataclasses.is_dataclass(read) else getattr(read, "__attrs_attrs__", ())
    return {one.name: getattr(read, one.name) for one in fields}
