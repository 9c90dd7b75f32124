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


_EARLY = "{state} did not start early: "
_TOLD: dict[Reason, str] = {
    Reason.STEADY: "nothing is foreseen beyond {state}",
    Reason.NOT_FORESEEN: _EARLY + "it is not foreseen any more",
    Reason.REPEATED: _EARLY + "it comes twice",
    Reason.NEEDS: _EARLY + "{name} is not yet as it needs it",
    Reason.CONFLICT: _EARLY + "{other} comes first, and shares {name} with it",
    Reason.BRANCH: _EARLY + "{other}, or what follows, may need {name} as it was",
    Reason.AGENT: _EARLY + "agent {name} has no place left",
    Reason.UTILITY: _EARLY + "its utility is too small, by the progress of {other}",
    Reason.MISTAKE: _EARLY + "its cost or the policy failed, as the log says",
    Reason.FAILED: _EARLY + "it has failed early",
}
_REMEDIES: dict[Reason, str] = {
    Reason.STEADY: "give its arrows known likelihoods, together more than 0.5",
    Reason.BRANCH: "give its Activity an undo=, or Prior(0.0) to arrows never taken",
    Reason.UTILITY: "report progress in {other}, or change threshold or utility",
}


def why_not_early(chart: MachineChart, one: Objection) -> WhyNotEarly:
    """An objection of a report, with the labels of its machine."""
    label = {number: f"'{state.label}'" for number, state in enumerate(chart.states)}
    words = {"state": label.get(one.state, "?"), "other": label.get(one.other, "?"), "name": f"'{one.name or 'all'}'"}
    told, remedy = _TOLD[one.reason], _REMEDIES.get(one.reason, "")
    return WhyNotEarly(told.format(**words), remedy.format(**words))


def came_late(before: CoordinationReport, now: CoordinationReport) -> list[Objection]:
    """The objections that held until a transition: to the activity of the state that is entered; and that nothing was
    foreseen, if an activity was done then.
    """
    steady = now.before if now.taken.split(" [")[0] == "done" else -1
    entered = now.current if now.taken else -1
    return [one for one in before.refused if one.state == (steady if one.reason is Reason.STEADY else entered)]
