"""Small random automata, and runs of these automata. The runs follow a coordinator's decisions, but
have no tasks.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from random import Random

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Do,
    Fact,
    LikelyArrow,
    Policy,
    PreviewLimits,
    Situation,
)
from tca_behaviours.coordination.preview.branches import BareArrow, live_facts
from tca_behaviours.coordination.preview.decide import EarlyWork, LookAhead, Present, WorkPhase
from tca_module import Command
from tca_wire.coordination import Reason

WORK = Command("work", str, progress=float)
BUSY = (WorkPhase.RUNNING, WorkPhase.STOPPING)


@dataclass
class RandomAutomaton:
    """An automaton whose likelihoods can be redrawn."""

    arrows: dict[int, list[LikelyArrow]]
    activities: dict[int, Activity] = field(default_factory=dict)

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        return self.arrows[state]

    def activity(self, state: int) -> Activity | None:
        return self.activities.get(state)

    def waits(self, state: int) -> bool:
        return state not in self.activities

    def redraw_likelihoods(self, random: Random) -> None:
        """Redraw all likelihoods."""
        for arrows in self.arrows.values():
            left = 8
            for place, arrow in enumerate(arrows):
                eighths = random.choice((left, random.randint(0, left)))
                arrows[place] = arrow._replace(likelihood=eighths / 8)
                left -= eighths


def random_activity(random: Random, agents: Sequence[Agent]) -> Activity:
    def facts(most: int) -> dict[str, Fact]:
        return {
            random.choice("wxyz"): random.choice((0, 0, 1)) for _ in range(random.randint(0, most))
        }

    tasks = [
        Do(WORK, "task", *random.sample(agents, random.randint(0, 2)))
        for _ in range(random.choice((1, 1, 2)))
    ]
    undo = (Do(WORK, "undo", random.choice(agents)),) if random.random() < 0.6 else ()
    return Activity(*tasks, needs=facts(1), makes=facts(2), undo=undo, cost=random.random())


def random_automaton(random: Random) -> RandomAutomaton:
    """Return an automaton of up to seven states. Its activities share some agents and variables."""
    agents = [Agent("one"), Agent("two"), Agent("three", tasks=2)]
    number = random.randint(2, 7)
    arrows = {}
    for state in range(number):
        targets = [random.randrange(number) for _ in range(random.randint(0, 2))]
        targets.append((state + 1) % number)
        random.shuffle(targets)
        arrows[state] = [
            LikelyArrow(random.choice(("failed", "done")), target, 0.0) for target in targets
        ]
    machine = RandomAutomaton(arrows)
    for state in range(number):
        if random.random() < 0.85:
            activity = random_activity(random, agents)
            if not any(count > agent.tasks for agent, count in agent_uses(activity.tasks).items()):
                machine.activities[state] = activity
    machine.redraw_likelihoods(random)
    return machine


def agent_uses(tasks: Sequence[Do]) -> Counter[Agent]:
    return Counter(agent for task in tasks for agent in task.agents)


class PlayedRun:
    """A run along random arrows. ``plain`` keeps the facts as they would be without a preview.

    Each step checks that early work is never in the way.
    """

    def __init__(
        self,
        machine: RandomAutomaton,
        policy: Policy,
        random: Random,
        limits: PreviewLimits | None = None,
    ) -> None:
        self.machine = machine
        self.policy = policy
        self.limits = limits or PreviewLimits(0.6)
        self.random = random
        ways = {
            state: [BareArrow(arrow.target, arrow.symbol == "failed") for arrow in arrows]
            for state, arrows in machine.arrows.items()
        }
        self.needed = live_facts(ways, machine.activities)
        self.plain: dict[str, Fact] = {"w": 0, "x": 0, "y": 0, "z": 0}
        self.now = dict(self.plain)
        self.work: list[EarlyWork] = []
        self.wasted: list[
            tuple[int, set[str]]
        ] = []  # states of wasted work, each with the facts that are still stale
        self.current = 0
        self.progress = 0.0
        self.is_begun = self.is_done = self.is_unfit = self.is_new = False
        self.started = self.kept = self.restored = 0
        self._enter(0)

    # --- events -----------------------------------------------------------------------------------

    def step(self) -> None:
        """Let a random event happen, then carry out the next decision."""
        happenings = (
            self._advance_current,
            self._advance_work,
            self._leave_state,
            self._draw_likelihoods,
        )
        self.random.choices(happenings, (2, 3, 1, 1))[0]()
        self._decide()
        self._begin_current()
        self.check()

    def _draw_likelihoods(self) -> None:
        self.machine.redraw_likelihoods(self.random)

    def _advance_current(self) -> None:
        """Advance the current activity by a step. The activity may be done then."""
        activity = self.machine.activity(self.current)
        if activity is None or not self.is_begun or self.is_done:
            return
        self.progress += 0.4
        if self.progress >= 1:
            self._complete(activity)

    def _complete(self, activity: Activity) -> None:
        self.is_done = True
        self.now |= activity.makes
        self.plain |= activity.makes

    def _advance_work(self) -> None:
        """Let early work advance, end or fail."""
        if not self.work:
            return
        work = self.work.pop(self.random.randrange(len(self.work)))
        activity = self.machine.activities[work.state]
        match work.phase:
            case WorkPhase.RUNNING:
                end = self.random.choice(
                    (WorkPhase.RUNNING, WorkPhase.DONE, WorkPhase.DONE, WorkPhase.FAILED)
                )
                self.work.append(replace(work, phase=end, progress=min(1.0, work.progress + 0.5)))
                if end is WorkPhase.DONE:
                    self.now |= activity.makes
                elif end is WorkPhase.FAILED:
                    self._mark_wasted(work.state)
            case WorkPhase.STOPPING:
                pass  # stopped
            case WorkPhase.RESTORING:
                self.restored += 1
                spoilt = next(one for one in self.wasted if one[0] == work.state)
                self.wasted.remove(spoilt)
                self.now |= {name: self.plain[name] for name in spoilt[1] if name in self.plain}
            case _:
                self.work.append(work)

    def _mark_wasted(self, state: int) -> None:
        """Mark the facts made by a state's activity as wasted."""
        if makes := set(self.machine.activities[state].makes):
            self.wasted.append((state, makes))

    # --- states -----------------------------------------------------------------------------------

    def _leave_state(self) -> None:
        """Leave the state by any arrow, however unlikely. If the activity could not start, leave by
        a failure arrow.
        """
        activity = self.machine.activity(self.current)
        if activity is not None and not self.is_begun and self.plain_needs_hold(activity):
            self.plain = {
                name: value for name, value in self.plain.items() if name not in activity.makes
            }
        arrows = [
            arrow
            for arrow in self.machine.arcs(self.current)
            if arrow.symbol == "failed" or not self.is_unfit
        ]
        if arrows:
            self._enter(self.random.choice(arrows).target)

    def plain_needs_hold(self, activity: Activity) -> bool:
        return all(self.plain.get(name) == value for name, value in activity.needs.items())

    def _enter(self, state: int) -> None:
        self.current, self.progress, self.is_begun, self.is_done, self.is_unfit = (
            state,
            0.0,
            False,
            False,
            False,
        )
        self.is_new = True
        activity = self.machine.activity(state)
        found = next(
            (
                one
                for one in self.work
                if one.state == state and one.phase in (*BUSY, "done", "failed")
            ),
            None,
        )
        if found is None or found.phase is WorkPhase.STOPPING or activity is None:
            return
        self.work.remove(found)
        if found.phase is WorkPhase.FAILED:
            return
        if not self.plain_needs_hold(activity):  # it fails without a preview, too
            self._mark_wasted(state)
            if found.phase is WorkPhase.RUNNING:
                self.work.append(replace(found, phase=WorkPhase.STOPPING))
            return
        self.kept += 1
        self._start_current(activity)
        self.progress = found.progress
        if found.phase is WorkPhase.DONE:
            assert all(self.now.get(name) == value for name, value in activity.makes.items())
            self._complete(activity)

    def _start_current(self, activity: Activity) -> None:
        """Start the current activity, in ``plain`` as well."""
        self.is_begun = True
        self.plain = {
            name: value for name, value in self.plain.items() if name not in activity.makes
        }
        self.wasted = [
            (state, left) for state, made in self.wasted if (left := made - activity.makes.keys())
        ]

    def _begin_current(self) -> None:
        activity = self.machine.activity(self.current)
        if activity is None or self.is_begun:
            return
        if not self.plain_needs_hold(activity):
            self.is_begun = self.is_done = self.is_unfit = True
            return
        if not self._facts_are_restored(activity) or any(
            self._conflicts(one, activity) for one in self.work
        ):
            return
        assert all(self.now.get(name) == value for name, value in activity.needs.items())
        self._start_current(activity)
        self.now = {name: value for name, value in self.now.items() if name not in activity.makes}

    def _conflicts(self, work: EarlyWork, activity: Activity) -> bool:
        other = self.machine.activities[work.state]
        if work.phase not in (*BUSY, WorkPhase.RESTORING):
            return False
        tasks = other.undo if work.phase is WorkPhase.RESTORING else other.tasks
        shared = agent_uses(tasks).keys() & agent_uses(activity.tasks).keys()
        full = any(
            self.held()[agent] + agent_uses(activity.tasks)[agent] > agent.tasks for agent in shared
        )
        needs = set() if work.phase is WorkPhase.RESTORING else other.needs.keys()
        clash = (
            activity.makes.keys() & (needs | other.makes.keys())
        ) or activity.needs.keys() & other.makes.keys()
        return work.state == self.current or full or bool(clash)

    def _facts_are_restored(self, activity: Activity) -> bool:
        """Whether no fact must be restored before an activity. If one must, begin to restore it."""
        for state, spoilt in reversed(self.wasted):
            takes_part = spoilt & activity.makes.keys() and not spoilt <= activity.makes.keys()
            if spoilt & activity.needs.keys() or (
                takes_part and self.machine.activities[state].undo
            ):
                undone = self.machine.activities[state]
                assert undone.undo, f"{spoilt} can't be restored"
                restoring = EarlyWork(state, WorkPhase.RESTORING)
                free = not any(
                    self._conflicts(one, Activity(*undone.undo, makes=undone.makes))
                    for one in self.work
                )
                if free and restoring not in self.work:
                    self.work.append(restoring)
                    self.now = {
                        name: value for name, value in self.now.items() if name not in undone.makes
                    }
                return False
        return True

    # --- decisions --------------------------------------------------------------------------------

    def _decide(self) -> None:
        spoilt = {name for _, names in self.wasted for name in names}
        situation = Situation("", self.plain, {}, min(self.progress, 1.0))
        present = Present(
            self.current, self.now, situation, self.is_done, self.is_new, self.work, spoilt
        )
        decision = LookAhead(self.policy, self.limits, self.needed).decide(self.machine, present)
        self.is_new = False
        for stop in decision.stops:
            work = next(
                one
                for one in self.work
                if one.state == stop.state and one.phase not in ("stopping", "restoring")
            )
            self.work.remove(work)
            if work.phase is not WorkPhase.FAILED:
                self._mark_wasted(work.state)
            if work.phase is WorkPhase.RUNNING:
                self.work.append(replace(work, phase=WorkPhase.STOPPING))
        for state, share in decision.shares.items():
            if any(one.state == state for one in self.work):
                continue  # already running, at another speed
            self.started += 1
            activity = self.machine.activities[state]
            assert all(self.now.get(name) == value for name, value in activity.needs.items())
            self.work.append(EarlyWork(state, share=share))
            self.now = {
                name: value for name, value in self.now.items() if name not in activity.makes
            }
        assert all(objection.reason is not Reason.NOT_FORESEEN for objection in decision.refused)

    # --- invariants -------------------------------------------------------------------------------

    def held(self) -> Counter[Agent]:
        held = Counter[Agent]()
        activity = self.machine.activity(self.current)
        if activity is not None and self.is_begun and not self.is_done:
            held += agent_uses(activity.tasks)
        for work in self.work:
            other = self.machine.activities[work.state]
            if work.phase in BUSY:
                held += agent_uses(other.tasks)
            elif work.phase is WorkPhase.RESTORING:
                held += agent_uses(other.undo)
        return held

    def check(self) -> None:
        assert all(count <= agent.tasks for agent, count in self.held().items()), (
            "an agent has too many tasks"
        )
        running = [self.machine.activities[one.state] for one in self.work if one.phase in BUSY]
        undone = [
            self.machine.activities[one.state]
            for one in self.work
            if one.phase is WorkPhase.RESTORING
        ]
        running += [Activity(*one.undo, makes=one.makes) for one in undone]
        activity = self.machine.activity(self.current)
        if activity is not None and self.is_begun and not self.is_done:
            running.append(activity)
        for one in running:
            for name, value in one.needs.items():
                assert name in one.makes or self.now.get(name) == value, (
                    f"{name} does not hold any more"
                )
            for other in running:
                if one is not other:
                    assert not one.makes.keys() & (other.needs.keys() | other.makes.keys()), (
                        "two change one variable"
                    )
        touched = {name for _, names in self.wasted for name in names}
        touched |= {name for one in self.work for name in self.machine.activities[one.state].makes}
        for name, value in self.plain.items():
            assert name in touched or self.now.get(name) == value, (
                f"{name} is not as it would be without a preview"
            )
