"""Columns that only grow, and frames with what was added to them since somebody last looked, as
JSON.
"""

from array import array
from collections.abc import Mapping
from typing import Any

import msgspec


class _Places(dict[str, int]):
    """The place of each text; one that is new gets the next."""

    def __missing__(self, text: str) -> int:
        place = self[str(text)] = len(self)  # nothing of a class of its own: JSON has no such texts
        return place


class Columns:
    """Columns by table and name, each with its kind behind its name, as in "id:i": "d" (64-bit
    floats), "i" (32-bit integers), "B" (bytes) or "t" (texts, of which it has the places among all
    texts). Those of one table grow together.
    """

    def __init__(self, tables: Mapping[str, str]) -> None:
        self._tables: dict[str, dict[str, array[Any]]] = {
            table: {name: array(name[-1].replace("t", "i")) for name in names.split()}
            for table, names in tables.items()
        }
        self._texts = _Places()

    def add(self, table: str, *values: float | str) -> int:
        """A new row of a table, in the order of its columns; its number."""
        first, *_ = columns = [*self._tables[table].values()]
        for column, value in zip(columns, values, strict=True):
            column.append(self._texts[value] if isinstance(value, str) else value)
        return len(first) - 1

    def frame(self, since: Mapping[str, int], more: Mapping[str, Any]) -> bytes:
        """All rows behind those places, with *more*."""
        rows = {
            table: {
                name: _encoded(column[since.get(table, 0) :]) for name, column in columns.items()
            }
            for table, columns in self._tables.items()
        }
        lengths = {
            table: len(next(iter(columns.values()))) for table, columns in self._tables.items()
        }
        lengths["text"] = len(self._texts)
        texts = list(self._texts)[since.get("text", 0) :]
        return msgspec.json.encode({"tables": rows, "texts": texts, "lengths": lengths, **more})


def _encoded(column: "array[Any]") -> msgspec.Raw:
    """JSON of one column: as Python's numbers all of them would take much more memory."""
    return msgspec.Raw(msgspec.json.encode(column.tolist()))
