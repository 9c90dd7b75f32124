"""Why an activity did not start ahead of its state, and what to do, in words."""

from typing import NamedTuple

from tca_wire.charts import MachineChart
from tca_wire.coordination import CoordinationReport, Objection, Reason


class WhyNotEarly(NamedTuple):
    """An objection in words."""

    told: str
    """``'reach' did not start early: it has failed early``."""
    remedy: str
    """The change that lets it start early; "" if it has to wait for its turn."""

    def __str__(self) -> str:
        return "; ".join(filter(None, self))


_TOLD: dict[Reason, str] = {
    Reason.STEADY: "nothing is foreseen beyond {state}",
    Reason.NOT_FORESEEN: "it is not foreseen any more",
    Reason.REPEATED: "it comes twice",
    Reason.NEEDS: "{name} is not as it needs it",
    Reason.CONFLICT: "{other} comes first, and shares {name} with it",
    Reason.BRANCH: "{other}, or what follows, may need {name} as it was",
    Reason.AGENT: "agent {name} has no place left",
    Reason.UTILITY: "its utility is too small, by the progress of {other}",
    Reason.MISTAKE: "its cost or the policy failed, as the log says",
    Reason.FAILED: "it has failed early",
}
_REMEDIES: dict[Reason, str] = {
    Reason.STEADY: "give its arrows known likelihoods, together more than 0.5",
    Reason.BRANCH: "give its Activity an undo=, or Prior(0.0) to arrows never taken",
    Reason.UTILITY: "report progress in {other}, or change threshold or utility",
}


def why_not_early(chart: MachineChart, one: Objection) -> WhyNotEarly:
    """An objection of a report, with the labels of its machine."""
    told, remedy = _filled(chart, one, _TOLD[one.reason]), _REMEDIES.get(one.reason, "")
    if one.reason is not Reason.STEADY:
        told = _filled(chart, one, "{state} did not start early: ") + told
    return WhyNotEarly(told, _filled(chart, one, remedy))


def why_stopped(chart: MachineChart, one: Objection) -> str:
    """An objection to an activity that has started early: ``'reach': it has failed early``."""
    return _filled(chart, one, "{state}: " + _TOLD[one.reason])


def _filled(chart: MachineChart, one: Objection, phrase: str) -> str:
    label = {number: f"'{state.label}'" for number, state in enumerate(chart.states)}
    return phrase.format(
        state=label.get(one.state, "?"),
        other=label.get(one.other, "?"),
        name=f"'{one.name or 'all'}'",
    )


def late_objections(before: CoordinationReport, now: CoordinationReport) -> list[Objection]:
    """The objections that held until a transition: to the activity of the state that is entered;
    and that nothing was foreseen, if an activity was done then.
    """
    steady = now.before if now.taken.split(" [")[0] == "done" else -1
    entered = now.current if now.taken else -1
    return [
        one
        for one in before.refused
        if one.state == (steady if one.reason is Reason.STEADY else entered)
    ]
