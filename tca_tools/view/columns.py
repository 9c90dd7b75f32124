"""Columns that only grow, and frames of bytes with what was added to them since somebody last looked.

A frame is a line of JSON, filled with blanks to a multiple of eight bytes, and behind it the columns' new numbers one
after the other, each column again filled up: a browser lays typed arrays over it without copying.
"""

import json
import sys
from array import array
from collections.abc import Mapping
from typing import Any

ALIGNED = 8


class _Places(dict[str, int]):
    """The place of each text; one that is new gets the next."""

    def __missing__(self, text: str) -> int:
        place = self[text] = len(self)
        return place


class Columns:
    """Columns by name, each of a kind: "d" (64-bit floats), "i" (32-bit integers), "B" (bytes) or "t" (texts, of which
    it has the places among all texts). Those of one table ("task.id", "task.parent") grow together.
    """

    def __init__(self, kinds: Mapping[str, str]) -> None:
        self._kinds = kinds
        self._columns = {name: array("i" if kind == "t" else kind) for name, kind in kinds.items()}
        self._tables: dict[str, list[tuple[array[Any], bool]]] = {}
        for name, column in self._columns.items():
            self._tables.setdefault(name.split(".")[0], []).append((column, kinds[name] == "t"))
        self._texts = _Places()

    def add(self, table: str, *values: float | str) -> int:
        """A new row of a table, in the order of its columns; its number."""
        columns, texts = self._tables[table], self._texts
        for (column, is_text), value in zip(columns, values, strict=True):
            column.append(texts[value] if is_text else value)  # type: ignore[index]
        return len(columns[0][0]) - 1

    def frame(self, since: Mapping[str, int], more: Mapping[str, Any]) -> bytes:
        """All rows behind those places, with *more* in the frame's head."""
        parts, head, offset = [], [], 0
        for name, column in self._columns.items():
            rows = column[since.get(name.split(".")[0], 0) :]
            if sys.byteorder == "big":
                rows.byteswap()
            data = rows.tobytes()
            about = {"kind": self._kinds[name], "offset": offset, "bytes": len(data)}
            head.append({"name": name, **about})
            parts.append(_filled(data, b"\0"))
            offset += len(parts[-1])
        lengths = {name: len(columns[0][0]) for name, columns in self._tables.items()} | {"text": len(self._texts)}
        texts = list(self._texts)[since.get("text", 0) :]
        told = {"columns": head, "texts": texts, "lengths": lengths, **more}
        return b"".join([_filled(json.dumps(told).encode() + b"\n", b" "), *parts])


def _filled(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % ALIGNED)
