"""Facts as rows of plain values: the JSON that other programs read."""

from typing import Any

import msgspec

from tca_wire.constraints import Constraint
from tca_wire.journal.facts import Entry, Fact, kind_of
from tca_wire.points import Point, describe_moments
from tca_wire.text.bodies import plain_data
from tca_wire.text.facts_in_words import fields_of

BAD_NEWS = {"failed", "killed", "dropped", "refused", "module left"}
"""The kinds of facts that are shown in red."""


def fact_row(entry: Entry, fact: Fact) -> dict[str, Any]:
    """Return a fact's fields, with its body decoded as *data*.

    *t* is its time in seconds, *entry* the number of its entry, and *cause* the entry's cause, if
    it is known.
    """
    fields = {name: _plain(value) for name, value in fields_of(fact).items()}
    if hasattr(fact, "body"):
        fields["data"] = plain_data(fact.body)
    row: dict[str, Any] = {"t": entry.time, "entry": entry.number}
    if (cause := entry.cause) is not None:
        row["cause"] = {"kind": str(cause.__struct_config__.tag), **msgspec.structs.asdict(cause)}
    return {**row, "kind": kind_of(fact), **fields}


def _plain(value: Any) -> Any:
    """Return the value of a field, with constraints and points as dictionaries."""
    match value:
        case list():
            return [_plain(one) for one in value]
        case Constraint(before, after, delay):
            return {"before": _plain(before), "after": _plain(after)} | (
                {"delay": delay} if delay else {}
            )
        case Point(task, moment):
            return {"task": task, "moment": ", ".join(describe_moments(moment))}
    return value
