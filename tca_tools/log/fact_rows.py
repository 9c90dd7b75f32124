"""Facts as rows of plain values, for JSON: the one form of them that other programs read."""

from typing import Any

import msgspec

from tca_wire.constraints import Constraint
from tca_wire.journal.causes import Cause
from tca_wire.journal.facts import Entry, Fact, KillPlanned, TimedOut, kind_of
from tca_wire.points import Point, describe_moments
from tca_wire.text.bodies import plain_data
from tca_wire.text.facts_in_words import fields_of


def fact_row(entry: Entry, fact: Fact) -> dict[str, Any]:
    """A fact's fields, its body decoded as *data*. *t* is its time (s), *entry* the number of its entry, and *cause*
    what that came from, if it is known.
    """
    fields = dict(fields_of(fact))
    if "constraints" in fields:
        fields["constraints"] = [_plain_constraint(constraint) for constraint in getattr(fact, "constraints", [])]
    if isinstance(fact, TimedOut):
        fields["constraint"] = _plain_constraint(fact.constraint)
    if isinstance(fact, KillPlanned):
        fields["after"] = None if fact.after is None else _plain_point(fact.after)
    if hasattr(fact, "body"):
        fields["data"] = plain_data(fact.body)
    cause = {"cause": _plain_cause(entry.cause)} if entry.cause else {}
    return {"t": entry.time, "entry": entry.number, **cause, "kind": kind_of(fact)} | fields


def _plain_cause(cause: Cause) -> dict[str, Any]:
    return {"kind": str(cause.__struct_config__.tag), **msgspec.structs.asdict(cause)}


def _plain_constraint(constraint: Constraint) -> dict[str, Any]:
    points = {"before": _plain_point(constraint.before), "after": _plain_point(constraint.after)}
    return points | ({"delay": constraint.delay} if constraint.delay else {})


def _plain_point(point: Point) -> dict[str, Any]:
    return {"task": point.task, "moment": ", ".join(describe_moments(point.moment))}
