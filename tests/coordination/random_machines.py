"""Random machines, a robot for their tasks, and random events around it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from random import Random

from coordination.delivery_robot import Play

from tca_behaviours.coordination import (
    Activity,
    Agent,
    AuthoredState,
    Coordination,
    Coordinator,
    Do,
    Perceived,
    Policy,
    Prior,
    UnsoundMachine,
)
from tca_behaviours.coordination.model.likelihoods import Likelihood
from tca_module import Client, Command, Failure, Module, Task, Variable, connect
from tca_module.testing import LocalCentral


@dataclass
class Work:
    """The data of a task."""

    name: str
    seconds: float
    fails: bool = False


EASY = Command("easy", Work, progress=float)
"""Tasks that a cancel kills."""
SLOW = Command("slow", Work, progress=float)
"""Tasks that take a second to stop."""
STUBBORN = Command("stubborn", Work, progress=float)
"""Tasks that refuse to be cancelled."""
KINDS = (EASY, SLOW, STUBBORN)
ODD = {EASY: 0.013, SLOW: 0.029, STUBBORN: 0.047}
"""Seconds by which tasks take longer, so that no two tasks end at the same time. The order of
simultaneous ends is undefined.
"""
AGENTS = {kind: Agent(kind.name) for kind in KINDS}
FREE = Variable("free", float)
TIRED = Failure("tired")
NAMES = ("x", "y", "z")
PATIENCE = 2.0


def random_machine(random: Random, *, unlikely: bool = False) -> Coordination:
    """Return a random sound machine. With *unlikely*, no transition is likely."""
    while True:
        try:
            return _machine(random, unlikely=unlikely)
        except UnsoundMachine:
            continue


def _machine(random: Random, *, unlikely: bool) -> Coordination:
    def likely(likelihood: Likelihood | None) -> Likelihood | None:
        return Prior(0.0) if unlikely else likelihood

    with Coordination("random", facts=dict.fromkeys(NAMES, 0)) as machine:
        states: list[AuthoredState] = []
        number = random.randint(3, 6)
        while len(states) < number:
            label = f"s{len(states)}"
            if random.random() < 0.2:
                with machine.compound(f"compound of {label}"):
                    inner = machine.state(label, _activity(random, label))
                    inner.to(machine.final(f"end of {label}"), likelihood=likely(None))
                states.append(inner.parent or inner)
            else:
                states.append(
                    machine.state(
                        label, _activity(random, label) if random.random() < 0.85 else None
                    )
                )
        states.append(machine.final("end"))
        for place, state in enumerate(states[:-1]):
            following, other = states[place + 1], random.choice(states)
            if state.activity is None and not state.children:
                state.to(following, on="go", likelihood=likely(random.choice([None, Prior(0.9)])))
                continue
            if random.random() < 0.7:
                state.to(other, when=FREE, likelihood=likely(Perceived(FREE)))
                state.to(following, likelihood=likely(Perceived(FREE, negated=True)))
            else:
                state.to(following, likelihood=likely(None))
            if random.random() < 0.4:
                state.to(random.choice(states), on="failed", likelihood=likely(Prior(0.05)))
            if random.random() < 0.3:
                state.to(random.choice(states), on="go", likelihood=likely(Prior(0.1)))
    return machine


def random_round(random: Random) -> Coordination:
    """Return a machine that runs in a loop, and skips some states unless FREE is true."""
    with Coordination("round", facts=dict.fromkeys(NAMES, 0)) as machine:
        waiting = machine.state("waiting")
        states = [
            machine.state(f"s{number}", _small_activity(random, number))
            for number in range(random.randint(3, 5))
        ]
        waiting.to(machine.final("end"), on="stop")
        waiting.to(states[0], on="go", likelihood=random.choice([None, Prior(0.9)]))
        for state, *later in zip(
            states, [*states[1:], waiting], [*states[2:], waiting, states[0]], strict=True
        ):
            random.shuffle(later)
            state.to(later[0], when=FREE, likelihood=Perceived(FREE))
            state.to(later[1], likelihood=Perceived(FREE, negated=True))
            state.to(waiting, on="failed", likelihood=Prior(0.0))
    return machine


def _small_activity(random: Random, number: int) -> Activity:
    kind = random.choice(KINDS)
    do = Do(kind, Work(f"s{number} {kind.name}", random.randint(1, 3) + ODD[kind]), AGENTS[kind])
    makes = {random.choice(NAMES): number} if random.random() < 0.3 else {}
    return Activity(do, makes=makes, undo=Do(kind, Work(f"undo s{number}", 1.007), AGENTS[kind]))


def _activity(random: Random, label: str) -> Activity:
    kinds = random.sample(KINDS, random.choice([1, 1, 2]))
    tasks = [
        Do(
            kind,
            Work(f"{label} {kind.name}", random.randint(1, 3) + ODD[kind], random.random() < 0.07),
            AGENTS[kind],
        )
        for kind in kinds
    ]
    makes = {name: random.randint(0, 2) for name in NAMES if random.random() < 0.4}
    needs = {name: random.randint(0, 1) for name in NAMES if random.random() < 0.35}
    undo = (
        [Do(kinds[0], Work(f"undo {label}", 1.007), AGENTS[kinds[0]])]
        if random.random() < 0.8
        else []
    )
    return Activity(*tasks, makes=makes, needs=needs, undo=undo, cost=random.random())


def make_robot(central: LocalCentral) -> Module:
    """Return a robot that carries out the data of its tasks."""
    robot = Module("robot", central)

    def work(task: Task, data: Work) -> None:
        task.report(0.0)
        for half in (0.5, 1.0):
            if task.wait_for_request(data.seconds / 2):
                task.sleep(1.0)
                raise task.aborted()
            task.report(half)
        if data.fails:
            raise TIRED(text=data.name)

    robot.handles(EASY, resource="easy")(work)
    robot.handles(SLOW, resource="slow", takes=["cancel"])(work)
    robot.handles(STUBBORN, resource="stubborn", refuses=["cancel"])(work)
    return robot


@contextmanager
def run_of(machine: Coordination, policy: Policy | None) -> Iterator[Play]:
    with LocalCentral(stepped=True) as central:
        coordinator = Coordinator(machine, policy=policy, patience=PATIENCE)
        module = Module("coordinator", central)
        coordinator.handle_in(module)
        with make_robot(central).running(), module.running(), connect("user", central) as user:
            yield Play(central, module, coordinator, user)


def disturb(random: Random, play: Play, seconds: float) -> None:
    """Let random events happen around the robot."""
    user = play.user
    acts: list[Callable[[], object]] = [
        lambda: play.event("go"),
        lambda: play.event("go"),
        lambda: _set_free(user, 1.0),
        lambda: _set_free(user, 0.3),
        lambda: _set_free(user, 0.0),
        lambda: _kill_one(random, user),
    ]
    for _ in range(int(seconds)):
        play.central.advance(random.choice([0.3, 1.0, 1.7]))
        if random.random() < 0.6:
            random.choice(acts)()
            play.central.until_quiet()


def _set_free(user: Client, free: float) -> None:
    user.set_variable(FREE, free)


def _kill_one(random: Random, user: Client) -> None:
    tasks = [task for kind in KINDS for task in user.tasks(kind)]
    if tasks:
        random.choice(tasks).kill("an operator")
