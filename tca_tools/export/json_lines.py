"""A run as JSON Lines: the facts as ``tca log show --json`` shows them."""

import json
from collections.abc import Iterable
from typing import BinaryIO

from tca_tools.log.fact_rows import fact_row
from tca_wire.journal.facts import Entry


def write_json_lines(entries: Iterable[Entry], stream: BinaryIO) -> None:
    """Write a line a fact."""
    for entry in entries:
        stream.writelines(json.dumps(fact_row(entry, fact)).encode() + b"\n" for fact in entry.facts)
