"""Frames of the page, decoded."""

import json
from typing import Any


def parsed(frame: bytes) -> tuple[dict[str, Any], dict[str, list[Any]]]:
    """Return a frame, and its columns by table and name."""
    content = json.loads(frame)
    columns = {
        f"{table}.{key.split(':')[0]}": values
        for table, some in content["tables"].items()
        for key, values in some.items()
    }
    return content, columns
