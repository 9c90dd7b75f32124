"""What a page makes of a frame."""

import json
from array import array
from collections.abc import Sequence
from typing import Any

from tca_tools.view.columns import ALIGNED


def parsed(frame: bytes) -> tuple[dict[str, Any], dict[str, Sequence[Any]]]:
    """A frame's head and columns."""
    end = frame.index(b"\n") + 1
    head, start = json.loads(frame[:end]), end + -end % ALIGNED
    columns: dict[str, Sequence[Any]] = {}
    for told in head["columns"]:
        numbers: array[Any] = array(told["kind"].replace("t", "i"))
        place = start + told["offset"]
        numbers.frombytes(frame[place : place + told["bytes"]])
        columns[told["name"]] = numbers
    return head, columns
