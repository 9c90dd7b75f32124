"""Why an activity did not start ahead of its state, and what to do, in words."""

from collections.abc import Callable
from typing import NamedTuple

from tca_wire.coordination import ActivityKind, CoordinationChart, CoordinationReport, Objection, Reason


class WhyNotEarly(NamedTuple):
    """An objection in words."""

    told: str
    """``'reach' did not start early: its utility is too small``."""
    remedy: str
    """The change that lets it start early; "" if it has to wait for its turn."""

    def __str__(self) -> str:
        return "; ".join(filter(None, self))


_Words = Callable[[Objection, str], tuple[str, str]]
"""From an objection, and the label of its other state, to its reason and its remedy."""

_PHRASES: dict[Reason, _Words] = {
    Reason.NOT_FORESEEN: lambda _, __: ("it is not foreseen any more", ""),
    Reason.REPEATED: lambda _, __: ("it comes twice", ""),
    Reason.NEEDS: lambda one, _: (f"'{one.name}' is not yet as it needs it", ""),
    Reason.CONFLICT: lambda one, other: (
        (f"{other} comes first, and makes or needs '{one.name}'" if one.name else "its tasks of last time still run"),
        "",
    ),
    Reason.BRANCH: lambda one, other: (
        (f"if {other} follows instead, '{one.name}' may be needed as it was" if one.other != one.state
         else f"it or what follows it needs '{one.name}' as it was, if it comes again or fails"),
        "give its Activity an undo=" + f", or the arrow to {other} likelihood=Prior(0.0) if it is never taken"
        * (one.other != one.state),
    ),
    Reason.AGENT: lambda one, _: (f"agent '{one.name}' has no place left", ""),
    Reason.UTILITY: lambda _, other: (
        f"its utility is too small for the policy, with the progress of {other} so far",
        f"let the handlers of {other} report progress, or give the policy a lower threshold or another utility",
    ),
    Reason.MISTAKE: lambda _, __: ("its cost, adapt or the policy failed, as the log says", ""),
    Reason.FAILED: lambda _, __: ("it has failed early", ""),
}  # fmt: skip


def why_not_early(chart: CoordinationChart, one: Objection) -> WhyNotEarly:
    """An objection of a report, with the labels of its machine."""
    label, other = _label(chart, one.state), _label(chart, one.other)
    if one.reason is Reason.STEADY:
        remedy = f"give the arrows of {label} likelihoods that are known, and together more than 0.5"
        return WhyNotEarly(f"nothing is foreseen beyond {label}", remedy)
    why, remedy = _PHRASES[one.reason](one, other)
    is_wait = one.reason is Reason.UTILITY and chart.states[one.other].kind is ActivityKind.WAIT
    return WhyNotEarly(f"{label} did not start early: {why}", "" if is_wait else remedy)


def came_late(before: CoordinationReport, now: CoordinationReport) -> list[Objection]:
    """The objections that held until a transition: to the activity of the state that is entered; and that nothing was
    foreseen, if an activity was done then.
    """
    is_done = now.taken.split(" [")[0] == "done"
    entered = {one for one in before.refused if one.state == now.current and one.reason is not Reason.STEADY}
    steady = [one for one in before.refused if one.reason is Reason.STEADY and is_done and one.state == now.before]
    return [*entered, *steady] if now.taken else []


def _label(chart: CoordinationChart, state: int) -> str:
    """In quotes; "" if there is no such state."""
    return f"'{chart.states[state].label}'" if 0 <= state < len(chart.states) else ""
