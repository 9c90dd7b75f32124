"""Images in the data of messages, as Foxglove shows them; data that were kept beside a journal."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tca_tools.export.schemas import object_schema
from tca_wire.errors import ProtocolError
from tca_wire.messages.arrays import ArrayInfo
from tca_wire.messages.large_data import OpenedBody
from tca_wire.packets.large import DATA_FOLDER, is_large, unpack_handle

_ENCODINGS = {1: "mono8", 3: "rgb8", 4: "rgba8"}
"""By number of channels: the name of the encoding."""
_TEXT, _INT = {"type": "string"}, {"type": "integer"}
TIME = object_schema("time", sec=_INT, nsec=_INT)
RAW_IMAGE = object_schema(
    "foxglove.RawImage",
    timestamp=TIME,
    frame_id=_TEXT,
    width=_INT,
    height=_INT,
    encoding=_TEXT,
    step=_INT,
    data=_TEXT | {"contentEncoding": "base64"},
)
"""Foxglove recognises the schema by its title."""


def data_folder(journal: Path, epoch: str) -> Path:
    """Return the folder with the data of messages with ``journal=True``; it may be missing."""
    return (journal if journal.is_dir() else journal.parent) / DATA_FOLDER / epoch


def with_kept_data(body: bytes, folder: Path) -> bytes:
    """Return a body with its large data from the folder; unchanged if they were not kept."""
    if not is_large(body):
        return body
    try:
        handle, _ = unpack_handle(body)
        content = (folder / handle.segment).read_bytes()
    except (ProtocolError, OSError):
        return body
    if len(content) < handle.size:
        return body
    opened = OpenedBody(body)
    opened.content = memoryview(content)
    return opened


def images_in(data: Any, place: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each image in plain data: its place, and a foxglove.RawImage without timestamp."""
    if isinstance(data, ArrayInfo):
        if image := _image(data):
            yield place, {"frame_id": place, **image}
    elif isinstance(data, dict):
        for name, field in data.items():
            yield from images_in(field, f"{place}/{name}")


def _image(array: ArrayInfo) -> dict[str, Any] | None:
    """Return an array of bytes as an image; None if its shape or content is not that of one."""
    match array:
        case {"dtype": "|u1", "shape": [height, width]}:
            channels = 1
        case {"dtype": "|u1", "shape": [height, width, (3 | 4) as channels]}:
            pass
        case _:
            return None
    if array.content is None or width <= 0 or not 0 < height * width * channels == array["bytes"]:
        return None
    return {
        "width": width,
        "height": height,
        "encoding": _ENCODINGS[channels],
        "step": width * channels,
        "data": base64.b64encode(array.content).decode(),
    }
