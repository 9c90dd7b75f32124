"""Decides which activities start, continue or stop ahead of their states.

A coordinator asks for a decision at every event.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import isnan, nan
from typing import NamedTuple

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.automaton import Automaton
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.preview.branches import first_harmed_fact
from tca_behaviours.coordination.preview.policy import Candidate, Policy, checked_share
from tca_behaviours.coordination.preview.reservations import Places, Reservations
from tca_behaviours.coordination.preview.walk import PreviewLimits, most_likely
from tca_wire.coordination import Foreseen, Objection, Reason


class WorkPhase(StrEnum):
    """The progress of an activity that is not the current one."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    STOPPING = "stopping"
    """The activity was asked to stop, and has not ended yet."""
    RESTORING = "restoring"
    """The tasks that undo the activity are running."""


@dataclass(frozen=True)
class EarlyWork:
    """An activity beside the current one."""

    state: int
    phase: WorkPhase = WorkPhase.RUNNING
    progress: float = 0.0
    share: float = 1.0
    """The share of full speed."""


@dataclass(frozen=True)
class Present:
    """The state of a run, as the decision reads it."""

    current: int
    """The current state of the machine. Its activity is not part of ``work``."""
    facts: Mapping[str, Fact]
    """The facts now, including the changes by early work: facts of the robot, not of the journal. A
    fact that running work makes is absent.
    """
    situation: Situation
    """The situation as a machine without a preview would see it."""
    is_done: bool = False
    """Whether the current activity is done, and the machine waits for an event."""
    is_new: bool = False
    """Whether the machine has taken a transition since the last decision."""
    work: Sequence[EarlyWork] = ()
    spoilt: Collection[str] = frozenset()
    """Facts that wasted work has changed, and that no task has restored or set since."""


@dataclass(frozen=True)
class Decision:
    """The preview list of a run, and what to start and stop because of it."""

    preview: list[Foreseen]
    shares: dict[int, float] = field(default_factory=dict)
    """By state, the share of full speed of activities that start early now, or change speed."""
    stops: list[Objection] = field(default_factory=list)
    """Early work that has become useless, whether it runs, is done or has failed."""
    refused: list[Objection] = field(default_factory=list)
    """Activities of the preview list that do not start now, with the reasons.

    The current activity is in this list, too, if no state is foreseen after the current one.
    """


class LookAhead(NamedTuple):
    """How a coordinator looks ahead."""

    policy: Policy
    limits: PreviewLimits
    needed: Mapping[int, Mapping[str, int]]
    """By state: the facts that a branch after it may need unchanged, with the first state of that
    branch (``needed_later`` in branches.py).
    """
    mistakes: Mistakes = Mistakes()
    """Receives the errors of functions that only a preview calls."""

    def decide(self, automaton: Automaton, present: Present) -> Decision:
        """Compute the preview list, and what to start and stop because of it."""
        decision = Decision(most_likely(automaton, present.current, self.limits))
        if not decision.preview and automaton.activity(present.current) is not None:
            decision.refused.append(Objection(present.current, Reason.STEADY))
        _DecisionMaker(self, automaton, present, decision).decide()
        return decision


class _DecisionMaker:
    """One decision. It considers the states of the list in order, the next one first."""

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
        self.reserved_earlier = Reservations()  # of the activities considered so far
        self.reserved_by_running = Reservations()  # of all running activities
        self.allotted_places = Places()  # of the activities considered so far
        self.held_places = Places()  # of the activities that run now
        self.uncertain = set(present.spoilt)  # facts whose values may be undone
        self._reserve_for_present()

    def decide(self) -> None:
        """Consider the states of the preview list in order, then other early work."""
        current = self.present.current
        seen, state_before, progress = {current}, current, self._progress_of_current()
        for index, foreseen in enumerate(self.decision.preview, start=1):
            state = foreseen.state
            activity = self.automaton.activity(state)
            if activity is not None:
                if state in seen:
                    self.decision.refused.append(Objection(state, Reason.REPEATED))
                else:
                    candidate = self._candidate(index, foreseen, activity, state_before, progress)
                    self._consider(candidate, activity)
                    work = self.work.get(state)
                    is_done = work is not None and work.phase is WorkPhase.DONE
                    self.reserved_earlier.add(
                        state, activity.needs, activity.makes, is_done=is_done
                    )
            if activity is not None or self.automaton.waits(state):
                state_before, progress = state, self._progress(state)
            seen.add(state)
        for work in self.present.work:
            if work.state in seen or work.phase in (WorkPhase.STOPPING, WorkPhase.RESTORING):
                continue
            if objection := self._objection_to_unforeseen(work):
                self.decision.stops.append(objection)

    # --- reservations -----------------------------------------------------------------------------

    def _reserve_for_present(self) -> None:
        """Reserve facts and places for the current activity and for running work."""
        current = self.automaton.activity(self.present.current)
        if current is not None and not self.present.is_done:
            self.reserved_earlier.add(self.present.current, current.needs, current.makes)
            self.reserved_by_running.add(self.present.current, current.needs, current.makes)
            self.allotted_places.occupy(current.tasks)
            self.held_places.occupy(current.tasks)
        for work in self.present.work:
            activity = self._activity(work.state)
            self.uncertain |= activity.makes.keys()
            if work.phase is WorkPhase.RUNNING:
                self.reserved_by_running.add(work.state, activity.needs, activity.makes)
                self.held_places.occupy(activity.tasks)
            elif work.phase is WorkPhase.STOPPING:
                self.reserved_earlier.add(work.state, activity.needs, activity.makes)
                self.held_places.occupy(activity.tasks)
            elif work.phase is WorkPhase.RESTORING:
                self.reserved_earlier.add(work.state, (), activity.makes)
                self.held_places.occupy(activity.undo)

    def _activity(self, state: int) -> Activity:
        activity = self.automaton.activity(state)
        assert activity is not None, f"state {state} has early work, and no activity"
        return activity

    # --- progress ---------------------------------------------------------------------------------

    def _progress_of_current(self) -> float:
        activity = self.automaton.activity(self.present.current)
        if activity is None:
            return 0.0
        if self.present.is_done or not activity.has_progress:
            return 1.0
        return self.present.situation.progress

    def _progress(self, state: int) -> float:
        """Return the progress of a foreseen state's activity, for the decision on later activities.

        The progress is 1 while an activity runs that can't report progress.
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
        """Return the candidate that the policy sees. *progress* is that of the state *before*."""
        work = self.work.get(foreseen.state)
        runs = work is not None and work.phase is WorkPhase.RUNNING
        cost = self._evaluate(activity, lambda: activity.cost(self.present.situation))
        return Candidate(
            state=foreseen.state,
            index=index,
            likelihood=foreseen.likelihood,
            probability=foreseen.probability,
            progress_before=progress,
            cost=cost,
            undo_cost=cost if first_harmed_fact(activity, self.needed) else 0.0,
            progress=work.progress if work is not None and runs else 0.0,
            share=work.share if work is not None and runs else 0.0,
            progress_of_current=self._progress_of_current(),
            state_before=before,
        )

    def _consider(self, candidate: Candidate, activity: Activity) -> None:
        """Decide whether the activity starts, continues, stops or is refused."""
        state = candidate.state
        work = self.work.get(state)
        if work is None:
            self._consider_start(candidate, activity)
        elif work.phase is WorkPhase.RUNNING:
            self._consider_running(candidate, activity)
        elif work.phase is WorkPhase.DONE:
            if objection := self.reserved_earlier.objection_to(state, (), activity.makes):
                self.decision.stops.append(objection)
            else:
                self.uncertain -= activity.makes.keys()
        elif work.phase is WorkPhase.FAILED:
            self.decision.refused.append(Objection(state, Reason.FAILED))
        else:
            self.decision.refused.append(Objection(state, Reason.CONFLICT, other=state))

    def _consider_start(self, candidate: Candidate, activity: Activity) -> None:
        state = candidate.state
        objection = self._objection_to_run(state, activity, is_running=False)
        objection = objection or self._objection_to_start(state, activity)
        share = self._allot(candidate, activity, objection, self.decision.refused)
        if not share:
            return
        if agent := self.held_places.full_agent(activity.tasks):
            # This agent is busy with work of a later state, which must end first.
            self.decision.refused.append(Objection(state, Reason.AGENT, agent.name))
            return
        self.held_places.occupy(activity.tasks)
        self.reserved_by_running.add(state, activity.needs, activity.makes)
        self.decision.shares[state] = share

    def _consider_running(self, candidate: Candidate, activity: Activity) -> None:
        objection = self._objection_to_run(candidate.state, activity, is_running=True)
        share = self._allot(candidate, activity, objection, self.decision.stops)
        if share and share != candidate.share:
            self.decision.shares[candidate.state] = share

    def _allot(
        self,
        candidate: Candidate,
        activity: Activity,
        objection: Objection | None,
        objections: list[Objection],
    ) -> float:
        """Reserve places for an activity, and return its share of full speed by the policy.

        If the activity may not run, return 0 and add the reason to *objections*.
        """
        share = 0.0 if objection else self._share(candidate, activity)
        if isnan(share):
            objection = Objection(candidate.state, Reason.MISTAKE)
        elif not objection and not share:
            objection = Objection(candidate.state, Reason.UTILITY, other=candidate.state_before)
        if not objection and (agent := self.allotted_places.full_agent(activity.tasks)):
            objection = Objection(candidate.state, Reason.AGENT, agent.name)
        if objection:
            objections.append(objection)
            return 0.0
        self.allotted_places.occupy(activity.tasks)
        return share

    def _share(self, candidate: Candidate, activity: Activity) -> float:
        """Return the share of full speed by the policy; NaN if the policy or the cost raises an
        error.
        """
        if isnan(candidate.cost):
            return nan
        share = self._evaluate(activity, lambda: checked_share(self.policy.share(candidate)))
        return share if activity.adapt is not None or share == 1 or isnan(share) else 0.0

    def _evaluate(self, activity: Activity, function: Callable[[], float]) -> float:
        """Return the result of a function; NaN if it raises an error."""
        return self.mistakes.value_or(nan, f"{activity!r} does not run early", function)

    # --- objections -------------------------------------------------------------------------------

    def _objection_to_run(
        self, state: int, activity: Activity, *, is_running: bool
    ) -> Objection | None:
        """Return the reason why an activity must not run now, if any.

        Running work may itself have changed the facts that it needed at its start.
        """
        for fact, value in activity.needs.items():
            is_certain = fact not in self.uncertain and self.present.facts.get(fact) == value
            if not is_certain and not (is_running and fact in activity.makes):
                return Objection(state, Reason.NEEDS, fact)
        return self.reserved_earlier.objection_to(state, activity.needs, activity.makes)

    def _objection_to_start(self, state: int, activity: Activity) -> Objection | None:
        """Return the reason why an activity must not start now, if any."""
        if objection := self.reserved_by_running.objection_to(
            state, activity.needs, activity.makes
        ):
            return objection
        if not activity.undo and (fact := first_harmed_fact(activity, self.needed)):
            return Objection(state, Reason.BRANCH, fact, self.needed[fact])
        uncertain_result = next((fact for fact in activity.makes if fact in self.uncertain), None)
        uncertain_needs = self.uncertain & self.needed.keys()
        if uncertain_result and uncertain_needs:  # to undo the needs would undo this result, too
            branch = self.needed[min(uncertain_needs)]
            return Objection(state, Reason.BRANCH, uncertain_result, branch)
        return None

    def _objection_to_unforeseen(self, work: EarlyWork) -> Objection | None:
        """Return the reason to stop work whose state is not foreseen any more, if any.

        Work that is done stays until the next transition, unless a running activity needs or
        changes its facts.
        """
        if work.phase is not WorkPhase.DONE or self.present.is_new:
            return Objection(work.state, Reason.NOT_FORESEEN)
        return self.reserved_by_running.objection_to(
            work.state, (), self._activity(work.state).makes
        )
