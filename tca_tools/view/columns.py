"""Columns of numbers that only grow, and frames of bytes with what was added to them since somebody last looked.

A frame is a line of JSON, filled with blanks to a multiple of eight bytes, and behind it the columns' new numbers one
after the other, each column again filled up: a browser lays typed arrays over it without copying.
"""

import json
import sys
from array import array
from collections.abc import Mapping
from typing import Any

ALIGNED = 8


class Column:
    """Numbers of one kind: "d" (64-bit floats), "i" (32-bit integers) or "B" (bytes)."""

    def __init__(self, kind: str) -> None:
        self.values: array[Any] = array(kind)

    def since(self, place: int) -> bytes:
        """What was added behind *place*, little endian."""
        added = self.values[place:]
        if sys.byteorder == "big":
            added.byteswap()
        return added.tobytes()


class Columns:
    """Columns by name; those of one table ("task.id", "task.parent") grow together."""

    def __init__(self, kinds: Mapping[str, str]) -> None:
        self._columns = {name: Column(kind) for name, kind in kinds.items()}
        self._tables: dict[str, list[Column]] = {}
        for name, column in self._columns.items():
            self._tables.setdefault(name.split(".")[0], []).append(column)
        self.texts: list[str] = []
        """Texts that the columns name by their place."""
        self._places: dict[str, int] = {}

    def add(self, table: str, *values: float) -> int:
        """A new row of a table, in the order of its columns; its number."""
        columns = self._tables[table]
        for column, value in zip(columns, values, strict=True):
            column.values.append(value)
        return len(columns[0].values) - 1

    def text(self, text: str) -> int:
        """The place of a text."""
        if (place := self._places.get(text)) is None:
            place = self._places[text] = len(self.texts)
            self.texts.append(text)
        return place

    def lengths(self) -> dict[str, int]:
        """How many rows each table has."""
        return {name: len(columns[0].values) for name, columns in self._tables.items()} | {"text": len(self.texts)}

    def frame(self, since: Mapping[str, int], more: Mapping[str, Any]) -> bytes:
        """All rows behind those places, with *more* in the frame's head."""
        parts, head, offset = [], [], 0
        for name, column in self._columns.items():
            rows = column.since(since.get(name.split(".")[0], 0))
            head.append({"name": name, "kind": column.values.typecode, "offset": offset, "bytes": len(rows)})
            parts.append(_filled(rows, b"\0"))
            offset += len(parts[-1])
        told = {"columns": head, "texts": self.texts[since.get("text", 0) :], "lengths": self.lengths(), **more}
        return b"".join([_filled(json.dumps(told).encode() + b"\n", b" "), *parts])


def _filled(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % ALIGNED)
