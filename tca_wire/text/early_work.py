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


def why_not_early(chart: MachineChart, objection: Objection) -> WhyNotEarly:
    """Return an objection of a report in words, with the labels of its machine."""
    phrase = "" if objection.reason is Reason.STEADY else "{state} did not start early: "
    return WhyNotEarly(
        _filled(chart, objection, phrase + _REASONS[objection.reason]),
        _filled(chart, objection, _REMEDIES.get(objection.reason, "")),
    )


def why_stopped(chart: MachineChart, objection: Objection) -> str:
    """Return an objection to an activity that started early, in words.

    For example ``'reach': it failed when it started early``.
    """
    return _filled(chart, objection, "{state}: " + _REASONS[objection.reason])


def _filled(chart: MachineChart, objection: Objection, phrase: str) -> str:
    """Fill a phrase with the labels of the states and the name of an objection."""
    labels = {number: f"'{state.label}'" for number, state in enumerate(chart.states)}
    return phrase.format(
        state=labels.get(objection.state, "?"),
        other=labels.get(objection.other, "?"),
        name=f"'{objection.name or 'all'}'",
    )


def late_objections(previous: CoordinationReport, report: CoordinationReport) -> list[Objection]:
    """Return the objections of the *previous* report that matter after the transition in *report*.

    They explain why the activity of the entered state did not start early. After the end of an
    activity, they also explain why no state was foreseen then.
    """
    left = report.before if report.taken.split(" [")[0] == "done" else -1
    entered = report.current if report.taken else -1
    return [
        objection
        for objection in previous.refused
        if objection.state == (left if objection.reason is Reason.STEADY else entered)
    ]
