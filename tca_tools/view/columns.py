"""Columns that only grow, and frames with the rows added since a page's last request, as JSON."""

from array import array
from collections.abc import Mapping
from typing import Any

import msgspec


class _Places(dict[str, int]):
    """The place of each text; a new text gets the next place."""

    def __missing__(self, text: str) -> int:
        place = self[str(text)] = len(self)  # a plain str, not a subclass, which JSON can't encode
        return place


class Columns:
    """Columns by table and name. The columns of one table grow together.

    Each name ends with its kind, as in "id:i": "d" (64-bit floats), "i" (32-bit integers), "B"
    (bytes) or "t" (texts, stored as places among all texts).
    """

    def __init__(self, tables: Mapping[str, str]) -> None:
        self._tables: dict[str, dict[str, array[Any]]] = {
            table: {name: array(name[-1].replace("t", "i")) for name in names.split()}
            for table, names in tables.items()
        }
        self._texts = _Places()

    def add(self, table: str, *values: float | str) -> int:
        """Add a row to a table, with values in the order of its columns. Return its number."""
        first, *_ = columns = [*self._tables[table].values()]
        for column, value in zip(columns, values, strict=True):
            column.append(self._texts[value] if isinstance(value, str) else value)
        return len(first) - 1

    def frame(self, since: Mapping[str, int], more: Mapping[str, Any]) -> bytes:
        """Return all rows from the places *since* on, with the fields of *more*, as JSON."""
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
    """Encode one column on its own: Python numbers of all columns would take much more memory."""
    return msgspec.Raw(msgspec.json.encode(column.tolist()))
