"""The reason why an activity did not start ahead of its state, and a remedy, in words."""

from typing import NamedTuple

from tca_wire.charts import MachineChart
from tca_wire.coordination import CoordinationReport, Objection, Reason


class WhyNotEarly(NamedTuple):
    """An objection in words."""

    reason: str
    """``'reach' did not start early: it failed when it started early``."""
    remedy: str
    """The change that lets it start early; "" if it must wait for its turn."""

    def __str__(self) -> str:
        return "; ".join(filter(None, self))


_REASONS: dict[Reason, str] = {
    Reason.STEADY: "no state is foreseen after {state}",
    Reason.NOT_FORESEEN: "it is no longer foreseen",
    Reason.REPEATED: "the machine is in it now, or comes to it earlier",
    Reason.NEEDS: "fact {name} does not have the value that it needs",
    Reason.CONFLICT: "{other} comes first and uses {name}, too",
    Reason.BRANCH: "{other}, or a state after it, may need {name} unchanged",
    Reason.AGENT: "agent {name} can take no more tasks",
    Reason.UTILITY: "its utility is too small at the progress of {other}",
    Reason.MISTAKE: "its cost or the policy failed: see the log",
    Reason.FAILED: "it failed when it started early",
}
_REMEDIES: dict[Reason, str] = {
    Reason.STEADY: "give its transitions known likelihoods with a sum above 0.5",
    Reason.BRANCH: "give its Activity an undo=, or Prior(0.0) to transitions that are never taken",
    Reason.UTILITY: "report progress in {other}, or change threshold or utility",
}


def why_not_early(chart: MachineChart, one: Objection) -> WhyNotEarly:
    """Return an objection of a report in words, with the labels of its machine."""
    reason, remedy = _filled(chart, one, _REASONS[one.reason]), _REMEDIES.get(one.reason, "")
    if one.reason is not Reason.STEADY:
        reason = _filled(chart, one, "{state} did not start early: ") + reason
    return WhyNotEarly(reason, _filled(chart, one, remedy))


def why_stopped(chart: MachineChart, one: Objection) -> str:
    """Return an objection to an activity that started early.

    For example ``'reach': it failed when it started early``.
    """
    return _filled(chart, one, "{state}: " + _REASONS[one.reason])


def _filled(chart: MachineChart, one: Objection, phrase: str) -> str:
    label = {number: f"'{state.label}'" for number, state in enumerate(chart.states)}
    return phrase.format(
        state=label.get(one.state, "?"),
        other=label.get(one.other, "?"),
        name=f"'{one.name or 'all'}'",
    )


def late_objections(before: CoordinationReport, now: CoordinationReport) -> list[Objection]:
    """Return the objections that held until a transition.

    They concern the activity of the state that is entered, or, if an activity has just finished,
    that no state was foreseen.
    """
    steady = now.before if now.taken.split(" [")[0] == "done" else -1
    entered = now.current if now.taken else -1
    return [
        one
        for one in before.refused
        if one.state == (steady if one.reason is Reason.STEADY else entered)
    ]
