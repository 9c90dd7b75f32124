"""Coordination with a preview, as data: the progress of a coordinator.

A report has the current state of the machine (``charts``), the foreseen states and the early tasks.
"""

from enum import StrEnum

import msgspec

from tca_wire.charts import decoded


class Foreseen(msgspec.Struct, frozen=True):
    """A state of the preview list."""

    state: int
    likelihood: float
    """Probability of the transition to it from the state before, in [0, 1]."""
    probability: float
    """Probability of the whole path up to it, in [0, 1]."""


class Reason(StrEnum):
    """The reason why an activity can't start before its turn."""

    STEADY = "steady"
    """No state is foreseen after the current one."""
    NOT_FORESEEN = "not foreseen"
    """Its state is no longer on the preview list."""
    REPEATED = "repeated"
    """Its state is also the current one, or also comes earlier: the machine returns to it."""
    NEEDS = "needs"
    """A fact that it needs does not hold, or holds only because of early work at risk."""
    CONFLICT = "conflict"
    """An earlier or running activity makes or needs the same fact; or its own last start is not
    stopped or undone yet.
    """
    BRANCH = "branch"
    """A state on another branch may need a fact that it changes, and the change can't be undone."""
    AGENT = "agent"
    """One of its agents can take no more tasks."""
    UTILITY = "utility"
    """The policy gives it too small a utility."""
    MISTAKE = "mistake"
    """Its cost or the policy raised an error, or returned no number."""
    FAILED = "failed"
    """It started early and failed."""


class Objection(msgspec.Struct, frozen=True, omit_defaults=True):
    """The first reason why the activity of a foreseen state can't start early."""

    state: int
    reason: Reason
    name: str = ""
    """The fact or agent that it is about."""
    other: int = -1
    """The other state.

    For CONFLICT it is the state with the conflicting activity. For BRANCH it is the first state of
    the branch, for UTILITY the state whose progress counts.
    """


class TaskRole(StrEnum):
    """The role of a coordinator's task in its machine."""

    CURRENT = "current"
    """It was sent when its state was entered, as without a preview."""
    AHEAD = "ahead"
    """It was sent before its state was entered."""
    KEPT = "kept"
    """It was sent early, and its state has been entered: the prediction was right."""
    WASTED = "wasted"
    """It was sent early, and was stopped or is useless: the prediction was wrong."""
    RESTORING = "restoring"
    """It undoes the changes of a wasted task."""


class RoleChange(msgspec.Struct, frozen=True):
    """A task has this role from now on."""

    task: int
    """Its id."""
    state: int
    """The state whose activity it belongs to."""
    agent: str
    role: TaskRole


class CoordinationReport(msgspec.Struct, frozen=True):
    """The progress of a coordinator, sent at each change."""

    current: int
    """The machine's current state, an innermost one."""
    taken: str = ""
    """The symbol of the transition taken just now; "" if the state has not changed."""
    before: int = -1
    """The state that the transition *taken* left."""
    preview: list[Foreseen] = []
    """The states that are likely to follow, the next one first."""
    news: list[RoleChange] = []
    """The tasks whose role has changed since the last report."""
    refused: list[Objection] = []
    """The objections to activities of the preview list that have not started early."""


def read_report(body: bytes) -> CoordinationReport | None:
    """Return the report of a coordinator; None for other bytes."""
    return decoded(body, CoordinationReport)
