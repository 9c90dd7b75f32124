"""Critical paths in random lives have no gaps and begin with an independent action. The facts alone
confirm each of their steps.
"""

import random
from itertools import pairwise
from math import nextafter

from central.player import before, point
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.blocking import Steps
from properties.seen_in_facts import Facts
from properties.test_recorded_waits import JournaledLife
from sampling import lives

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path
from tca_tools.analysis.step_words import why_not_sooner
from tca_tools.analysis.steps import Doing
from tca_tools.explain.graph import Ends
from tca_tools.journal.at_time import RunAt
from tca_wire.packets import headers
from tca_wire.points import Moment

KINDS = [
    "send",
    "send",
    "send",
    "ask",
    "ask all",
    "ask all",
    "ask and go on",
    "fetch",
    "wait",
    "wait",
    "lock",
    "give up",
    "return",
    "return",
    "return",
    "kill",
    "suspend",
    "lose",
    "constrain",
    "delay",
    "deadline",
]
numbers = st.integers(0, 50)
steps = st.lists(st.tuples(st.sampled_from(KINDS), numbers, numbers, numbers), max_size=40)


NOT_KNOWN = (Doing.KILLED, Doing.UNKNOWN, Doing.HELD)
"""Kinds of steps whose cause is unknown. The list of waits must not name the cause either."""


class UncomparedLife(JournaledLife):
    """A life without the comparison of waits, which test_recorded_waits.py makes."""

    def compare(self) -> None:
        pass

    def do(self, operation: str, a: int, b: int, c: int) -> None:
        tasks = [*self.central.tree.tasks]
        if operation not in ("delay", "deadline"):
            super().do(operation, a, b, c)
        elif operation == "deadline" and tasks:
            place = point(tasks[a % len(tasks)], list(Moment)[b % 6])
            self.request("operator", headers.Deadline, place, c % 10)
        elif tasks:
            pair = point(tasks[a % len(tasks)], list(Moment)[b % 6]), point(-1, list(Moment)[c % 6])
            self.send(
                "operator", ("walk", "move", "step")[a % 3], constraints=(before(*pair, b % 5),)
            )


def sixty_steps(seed: int) -> Steps:
    """Return sixty steps. Each kind of step has the same probability."""
    dice = random.Random(seed)
    return [
        (dice.choice(KINDS), dice.randrange(51), dice.randrange(51), dice.randrange(51))
        for _ in range(60)
    ]


steps_of_lives = steps | st.integers(0, 1 << 32).map(sixty_steps)

ONE_COPY_WAITS = [
    ("ask all", 0, 0, 0),
    ("send", 0, 2, 0),
    ("lock", 2, 1, 0),
    ("lock", 1, 2, 0),
    ("send", 0, 0, 0),
]
"""One copy of a multi-query is in a deadlock of locks. The handler of the other copy works."""

CYCLE_UNDER_A_SUSPENSION = [
    ("send", 0, 1, 0),
    ("delay", 2, 0, 0),
    ("ask", 2, 1, 0),
    ("ask", 1, 1, 0),
    ("return", 1, 0, 0),
    ("lock", 1, 2, 0),
    ("suspend", 0, 0, 1),
    ("send", 0, 0, 0),
    ("lock", 0, 1, 0),
]
"""The handler of a suspended task goes on, and asks for a lock that it waits for in vain."""


@example(sixty_steps(752))  # a killed task whose handler continues
@example(sixty_steps(7511))  # a task killed before its delay is over
@example(sixty_steps(1789))  # a deadlock of locks
@example(sixty_steps(1027))  # a multi-query is given up while a copy is queued
@example(sixty_steps(105_215_145))  # a task under a suspended one was resumed alone
@example(ONE_COPY_WAITS)
@example(CYCLE_UNDER_A_SUSPENSION)
@given(steps_of_lives)
@settings(max_examples=lives(20, soak=3_500))
def test_critical_path_matches_facts(taken: Steps) -> None:
    life = UncomparedLife().live(taken)
    run = life.history
    seen, causes = Facts(life.entries, list(run.times)), Causes(run)
    for task in run.tasks.values():
        path = critical_path(run, causes, task)
        if not path.steps:
            continue
        shown = "\n".join(
            f"{one.start}-{one.end} {one.doing} {run.describe(one.message_id)} {one.module}: {why_not_sooner(run, one)}"
            for one in path.steps
        )
        assert path.end == min(seen.ends(task.id), run.time), f"{task} ends after its path\n{shown}"
        for one, after in pairwise(path.steps):
            assert one.end == after.start, f"a gap in the path of {task}\n{shown}"
        for one in path.steps:
            assert seen.confirms(one), (
                f"of {task}: {one.doing} from {one.start} is not confirmed\n{shown}"
            )
            known = (
                run.messages.get(one.message_id)
                if one.doing in NOT_KNOWN and one.seconds > 0
                else None
            )
            ends = Ends.at(RunAt(run, nextafter(one.end, 0.0))).of(known.id) if known else ()
            assert all(end.kind is None for end in ends), (
                f"{one.doing} of {task}, but its waits have a known end\n{shown}"
            )
        assert seen.is_independent(path.start), f"the path of {task} begins too late\n{shown}"
