"""Coordination with a preview, as data: the progress of a coordinator.

It says which state its machine (``charts``) is in, which states it foresees, and which of its tasks
are early.
"""

from enum import StrEnum

import msgspec

from tca_wire.charts import decoded


class Foreseen(msgspec.Struct, frozen=True):
    """A state of the preview list."""

    state: int
    likelihood: float
    """Probability of the transition that leads to it from the state before, in [0, 1]."""
    probability: float
    """Probability of the whole path up to it, in [0, 1]."""


class Reason(StrEnum):
    """The objection to an activity that would start before its turn."""

    STEADY = "steady"
    """The machine is in its state, and no state is foreseen after it."""
    NOT_FORESEEN = "not foreseen"
    """Its state is not on the preview list any more."""
    REPEATED = "repeated"
    """Its state is the current one, or stands earlier in the list: the machine comes back to it."""
    NEEDS = "needs"
    """A fact that it needs does not hold now, or holds only because of early work that may be in
    vain.
    """
    CONFLICT = "conflict"
    """An activity that comes before it, or that runs, makes or needs the same variable; or its
    tasks of last time have not ended.
    """
    BRANCH = "branch"
    """On another branch, a state may need what it changes, and it can't be undone."""
    AGENT = "agent"
    """An agent of it has no place left."""
    UTILITY = "utility"
    """The policy finds it not worth while."""
    MISTAKE = "mistake"
    """Its cost or the policy raised, or gave no number."""
    FAILED = "failed"
    """It has been tried ahead, and has failed."""


class Objection(msgspec.Struct, frozen=True, omit_defaults=True):
    """The first objection to the activity of a state that is foreseen."""

    state: int
    reason: Reason
    name: str = ""
    """Of the variable or agent that it is about."""
    other: int = -1
    """The other state: of the activity in conflict, where the branch begins, or whose progress the
    utility counts.
    """


class TaskRole(StrEnum):
    """What a task of a coordinator is to its machine, as the run goes on."""

    CURRENT = "current"
    """It was sent when its state was entered, as without a preview."""
    AHEAD = "ahead"
    """It was sent before its state was entered."""
    KEPT = "kept"
    """It was ahead, and its state has been entered: the prediction was right."""
    WASTED = "wasted"
    """It was ahead, and has been stopped or is of no use any more: the prediction was wrong."""
    RESTORING = "restoring"
    """It undoes what a wasted task has changed."""


class RoleChange(msgspec.Struct, frozen=True):
    """From now on, a task has this role."""

    task: int
    """Its id."""
    state: int
    """The state of whose activity it is."""
    agent: str
    role: TaskRole


class CoordinationReport(msgspec.Struct, frozen=True):
    """The progress of a coordinator. One is sent at each change."""

    current: int
    """The state that the machine is in; always one that holds no other."""
    taken: str = ""
    """The symbol of the transition that was taken just now; "" if the state is the same as
    before.
    """
    before: int = -1
    """The state that was left by that transition."""
    preview: list[Foreseen] = []
    """The states that are likely to follow, the next one first."""
    news: list[RoleChange] = []
    """The tasks whose role has changed since the last report."""
    refused: list[Objection] = []
    """The activities of the preview list that have not started early, and the objections."""


def read_report(body: bytes) -> CoordinationReport | None:
    """A report of a coordinator; None if the bytes are none."""
    return decoded(body, CoordinationReport)
