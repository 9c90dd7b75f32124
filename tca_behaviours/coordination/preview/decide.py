"""What to do ahead, as things are: the one question that a coordinator asks at every event."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import isnan, nan
from typing import NamedTuple

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.automaton import Automaton
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.preview.branches import harmed
from tca_behaviours.coordination.preview.policy import Candidate, Policy, checked_share
from tca_behaviours.coordination.preview.reservations import Places, Reservations
from tca_behaviours.coordination.preview.walk import PreviewLimits, most_likely
from tca_wire.coordination import Foreseen, Objection, Reason


class WorkPhase(StrEnum):
    """How far the activity of a state is that is not the current one."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    STOPPING = "stopping"
    """It has been told to stop, and has not ended yet."""
    RESTORING = "restoring"
    """What undoes it is running."""


@dataclass(frozen=True)
class EarlyWork:
    """An activity beside the current one."""

    state: int
    phase: WorkPhase = WorkPhase.RUNNING
    progress: float = 0.0
    share: float = 1.0
    """Of full speed."""


@dataclass(frozen=True)
class Present:
    """How a run stands."""

    current: int
    """The state that the machine is in. Its activity is none of the early work."""
    facts: Mapping[str, Fact]
    """As the robot is, with what early work has changed; what is being changed is absent."""
    situation: Situation
    """As the machine without a preview would see it. Its progress is that of the current
    activity.
    """
    is_done: bool = False
    """Whether the current activity has been done, and the machine waits for something else."""
    is_new: bool = False
    """Whether the machine has taken a transition since the last decision."""
    work: Sequence[EarlyWork] = ()
    spoilt: Collection[str] = frozenset()
    """Variables that early work has changed in vain, and that have not been restored or made
    anew.
    """


@dataclass(frozen=True)
class Decision:
    """What follows from how a run stands."""

    preview: list[Foreseen]
    shares: dict[int, float] = field(default_factory=dict)
    """By state, the share of full speed of activities that start now, before their turn, or get
    another speed.
    """
    stops: list[Objection] = field(default_factory=list)
    """Early work that is of no use any more, whether it runs, is done or has failed."""
    refused: list[Objection] = field(default_factory=list)
    """Activities of the list that do not start now, and why; and the current one if no state is
    foreseen after it.
    """


class LookAhead(NamedTuple):
    """How a coordinator looks ahead."""

    policy: Policy
    limits: PreviewLimits
    needed: Mapping[int, Mapping[str, int]]
    """As ``needed_later`` found it."""
    mistakes: Mistakes = Mistakes()
    """Takes what functions raise that only a preview calls."""

    def decide(self, automaton: Automaton, present: Present) -> Decision:
        """The preview list, and what is started and stopped by it."""
        decision = Decision(most_likely(automaton, present.current, self.limits))
        if not decision.preview and automaton.activity(present.current) is not None:
            decision.refused.append(Objection(present.current, Reason.STEADY))
        _Deciding(self, automaton, present, decision).decide()
        return decision


class _Deciding:
    """One decision: the states of the list have their turns, the next one first."""

    def __init__(
        self, ahead: LookAhead, automaton: Automaton, present: Present, decision: Decision
    ) -> None:
        self.automaton = automaton
        self.present = present
        self.policy = ahead.policy
        self.needed = ahead.needed[present.current]
        self.decision = decision
        self.mistakes = ahead.mistakes
        self.work = {work.state: work for work in present.work}
        self.before = Reservations()  # by what comes first
        self.running = Reservations()  # by all that runs, in whatever order
        self.allotted = Places()  # by turn
        self.held = Places()  # as it is now, whoever's turn it is
        self.unsettled = set(present.spoilt)  # variables whose values may be in vain
        self._reserve()

    def decide(self) -> None:
        current = self.present.current
        seen, before, progress = {current}, current, self._progress_of_current()
        for index, foreseen in enumerate(self.decision.preview, start=1):
            state = foreseen.state
            activity = self.automaton.activity(state)
            if activity is not None:
                if state in seen:
                    self.decision.refused.append(Objection(state, Reason.REPEATED))
                else:
                    self._turn(
                        self._candidate(index, foreseen, activity, before, progress), activity
                    )
                    work = self.work.get(state)
                    is_done = work is not None and work.phase is WorkPhase.DONE
                    self.before.add(state, activity.needs, activity.makes, is_done=is_done)
            if activity is not None or self.automaton.waits(state):
                before, progress = state, self._progress(state)
            seen.add(state)
        for work in self.present.work:
            if work.state in seen or work.phase in (WorkPhase.STOPPING, WorkPhase.RESTORING):
                continue
            if objection := self._objection_to_unforeseen(work):
                self.decision.stops.append(objection)

    # --- what is reserved -------------------------------------------------------------------------

    def _reserve(self) -> None:
        """For the current activity, which goes first, and for all that runs."""
        current = self.automaton.activity(self.present.current)
        if current is not None and not self.present.is_done:
            self.before.add(self.present.current, current.needs, current.makes)
            self.running.add(self.present.current, current.needs, current.makes)
            self.allotted.take(current.tasks)
            self.held.take(current.tasks)
        for work in self.present.work:
            activity = self._activity(work.state)
            self.unsettled |= activity.makes.keys()
            if work.phase is WorkPhase.RUNNING:
                self.running.add(work.state, activity.needs, activity.makes)
                self.held.take(activity.tasks)
            elif work.phase is WorkPhase.STOPPING:
                self.before.add(work.state, activity.needs, activity.makes)
                self.held.take(activity.tasks)
            elif work.phase is WorkPhase.RESTORING:
                self.before.add(work.state, (), activity.makes)
                self.held.take(activity.undo)

    def _activity(self, state: int) -> Activity:
        activity = self.automaton.activity(state)
        assert activity is not None, f"state {state} has early work, and no activity"
        return activity

    # --- progress ---------------------------------------------------------------------------------

    def _progress_of_current(self) -> float:
        activity = self.automaton.activity(self.present.current)
        if activity is None:
            return 0.0
        return (
            1.0
            if self.present.is_done or not activity.has_progress
            else self.present.situation.progress
        )

    def _progress(self, state: int) -> float:
        """Of the activity of a foreseen state, as those after it see it: 1 where none can be
        reported.
        """
        activity, work = self.automaton.activity(state), self.work.get(state)
        if activity is None or work is None:
            return 0.0
        running = work.progress if activity.has_progress else 1.0
        return {WorkPhase.RUNNING: running, WorkPhase.DONE: 1.0}.get(work.phase, 0.0)

    # --- one activity -----------------------------------------------------------------------------

    def _candidate(
        self, index: int, foreseen: Foreseen, activity: Activity, before: int, progress: float
    ) -> Candidate:
        """*progress*: of the activity of the state *before*."""
        work = self.work.get(foreseen.state)
        runs = work is not None and work.phase is WorkPhase.RUNNING
        cost = self._valued(nan, activity, lambda: activity.cost(self.present.situation))
        return Candidate(
            state=foreseen.state,
            index=index,
            likelihood=foreseen.likelihood,
            probability=foreseen.probability,
            progress_before=progress,
            cost=cost,
            undo_cost=cost if harmed(activity, self.needed) else 0.0,
            progress=work.progress if work is not None and runs else 0.0,
            share=work.share if work is not None and runs else 0.0,
            progress_of_current=self._progress_of_current(),
            state_before=before,
        )

    def _turn(self, candidate: Candidate, activity: Activity) -> None:
        """Start it, let it go on, stop it or refuse it."""
        state = candidate.state
        work = self.work.get(state)
        if work is None:
            self._begin(candidate, activity)
        elif work.phase is WorkPhase.RUNNING:
            self._go_on(candidate, activity)
        elif work.phase is WorkPhase.DONE:
            if objection := self.before.clash(state, (), activity.makes):
                self.decision.stops.append(objection)
            else:
                self.unsettled -= activity.makes.keys()
        elif work.phase is WorkPhase.FAILED:
            self.decision.refused.append(Objection(state, Reason.FAILED))
        else:
            self.decision.refused.append(Objection(state, Reason.CONFLICT, other=state))

    def _begin(self, candidate: Candidate, activity: Activity) -> None:
        state = candidate.state
        objection = self._objection(state, activity, is_running=False) or self._objection_to_start(
            state, activity
        )
        share = self._allotted_share(candidate, activity, objection, self.decision.refused)
        if not share:
            return
        if agent := self.held.full(activity.tasks):  # what runs there has to end first
            self.decision.refused.append(Objection(state, Reason.AGENT, agent.name))
            return
        self.held.take(activity.tasks)
        self.running.add(state, activity.needs, activity.makes)
        self.decision.shares[state] = share

    def _go_on(self, candidate: Candidate, activity: Activity) -> None:
        objection = self._objection(candidate.state, activity, is_running=True)
        share = self._allotted_share(candidate, activity, objection, self.decision.stops)
        if share and share != candidate.share:
            self.decision.shares[candidate.state] = share

    def _allotted_share(
        self,
        candidate: Candidate,
        activity: Activity,
        objection: Objection | None,
        objections: list[Objection],
    ) -> float:
        """The share of full speed that the policy wants, with places at the agents; or 0, with an
        objection more.
        """
        share = 0.0 if objection else self._share(candidate, activity)
        if isnan(share):
            objection = Objection(candidate.state, Reason.MISTAKE)
        elif not objection and not share:
            objection = Objection(candidate.state, Reason.UTILITY, other=candidate.state_before)
        if not objection and (agent := self.allotted.full(activity.tasks)):
            objection = Objection(candidate.state, Reason.AGENT, agent.name)
        if objection:
            objections.append(objection)
            return 0.0
        self.allotted.take(activity.tasks)
        return share

    def _share(self, candidate: Candidate, activity: Activity) -> float:
        if isnan(candidate.cost):
            return nan
        share = self._valued(nan, activity, lambda: checked_share(self.policy.share(candidate)))
        return share if activity.adapt is not None or share == 1 or isnan(share) else 0.0

    def _valued(self, otherwise: float, activity: Activity, function: Callable[[], float]) -> float:
        return self.mistakes.otherwise(otherwise, f"{activity!r} does not run early", function)

    # --- objections -------------------------------------------------------------------------------

    def _objection(self, state: int, activity: Activity, *, is_running: bool) -> Objection | None:
        """What speaks against an activity that is to run now. One that runs may have changed what
        it needed.
        """
        for variable, value in activity.needs.items():
            is_settled = (
                variable not in self.unsettled and self.present.facts.get(variable) == value
            )
            if not is_settled and not (is_running and variable in activity.makes):
                return Objection(state, Reason.NEEDS, variable)
        return self.before.clash(state, activity.needs, activity.makes)

    def _objection_to_start(self, state: int, activity: Activity) -> Objection | None:
        """What speaks against an activity that does not run yet."""
        if clash := self.running.clash(state, activity.needs, activity.makes):
            return clash
        if not activity.undo and (variable := harmed(activity, self.needed)):
            return Objection(state, Reason.BRANCH, variable, self.needed[variable])
        variable = next(
            (variable for variable in activity.makes if variable in self.unsettled), None
        )
        spoilt = self.unsettled & self.needed.keys()
        if variable and spoilt:  # what undoes that work would take this result with it
            return Objection(state, Reason.BRANCH, variable, self.needed[min(spoilt)])
        return None

    def _objection_to_unforeseen(self, work: EarlyWork) -> Objection | None:
        """What is done stays while the current state does, and nothing that runs needs or makes the
        same variable.
        """
        if work.phase is not WorkPhase.DONE or self.present.is_new:
            return Objection(work.state, Reason.NOT_FORESEEN)
        return self.running.clash(work.state, (), self._activity(work.state).makes)
