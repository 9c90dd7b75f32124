"""The cost of a preview, by the length of its list.

    python -m dev.benchmarks.preview [--lengths 10,100,1000,10000] [--rounds 7]

Most machines are chains of states, whose activities use four agents and variables in turn. A second
arrow of each state leads to a dead end, back to the start, or (almost as likely) over the next
state. The last machine is a tree of equally likely arrows, where the walk has to visit every state.
"""

import gc
from collections.abc import Callable, Sequence
from functools import partial

from dev.benchmarks import options_of
from dev.benchmarks.messages.contestant import timed
from tca_behaviours.coordination import (
    Activity,
    Agent,
    Discrete,
    Do,
    LikelyArrow,
    PreviewLimits,
    Situation,
    most_likely,
)
from tca_behaviours.coordination.preview.branches import BareArrow, live_facts
from tca_behaviours.coordination.preview.decide import LookAhead, Present
from tca_module import Command

AGENTS = [Agent(name) for name in ("base", "arm", "gripper", "camera")]
MOVE = Command("move", str, progress=float)
LIMITS = PreviewLimits()


class Chain:
    """A chain of states from 0 to the length. Dead ends are states of their own."""

    def __init__(self, arrows: Callable[[int, int], Sequence[LikelyArrow]], length: int) -> None:
        self.visited = 0
        self.length = length
        self._arrows = [
            list(arrows(state, length)) if state < length else [] for state in range(2 * length + 1)
        ]
        self._activities = [self._activity(state) for state in range(2 * length + 1)]

    @staticmethod
    def _activity(state: int) -> Activity:
        agent = AGENTS[state % len(AGENTS)]
        return Activity(Do(MOVE, "there", agent), makes={agent.name: state}, cost=0.1)

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        self.visited += 1
        return self._arrows[state]

    def activity(self, state: int) -> Activity | None:
        return self._activities[state]

    def waits(self, state: int) -> bool:
        return state < 0

    @property
    def needed(self) -> dict[int, dict[str, int]]:
        bare = {
            state: [BareArrow(arrow.target) for arrow in arrows]
            for state, arrows in enumerate(self._arrows)
        }
        return live_facts(bare, dict(enumerate(self._activities)))


def plain(state: int, _: int) -> list[LikelyArrow]:
    return [LikelyArrow("done", state + 1, 1.0)]


def dead_ends(state: int, length: int) -> list[LikelyArrow]:
    return [
        LikelyArrow("failed", length + 1 + state, 0.0001),
        LikelyArrow("done", state + 1, 0.9999),
    ]


def back(state: int, _: int) -> list[LikelyArrow]:
    return [LikelyArrow("failed", 0, 0.1), LikelyArrow("done", state + 1, 0.9)]


def ladder(state: int, length: int) -> list[LikelyArrow]:
    """Return an arrow that skips the next state, and one that does not."""
    return [
        LikelyArrow("short", min(state + 2, length), 0.45),
        LikelyArrow("done", state + 1, 0.55),
    ]


def tree(state: int, _: int) -> list[LikelyArrow]:
    return [LikelyArrow(f"done {way}", 2 * state + way, 0.5) for way in (1, 2)]


CASES = {
    "no other arrow": plain,
    "unlikely dead ends": dead_ends,
    "back to the start": back,
    "almost equal": ladder,
    "tree, all equal": tree,
}


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--lengths", default="10,100,1000,10000")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    gc.disable()
    print(
        f"{'arrows':20} {'states':>7} {'list':>7} {'visited':>10} {'walk ms':>9} {'us/state':>9}"
        f" {'decision ms':>12}"
    )
    for case, arrows in CASES.items():
        for length in map(int, options.lengths.split(",")):
            chain = Chain(arrows, length)
            found = most_likely(chain, 0, LIMITS)
            visited = chain.visited
            walk_ms = 1e3 * min(timed(options.rounds, partial(most_likely, chain, 0, LIMITS)))
            present = Present(0, {}, Situation(progress=0.7))
            ahead = LookAhead(Discrete(), LIMITS, chain.needed)
            decision_ms = 1e3 * min(timed(options.rounds, partial(ahead.decide, chain, present)))
            per_state = 1e3 * walk_ms / len(found)
            print(
                f"{case:20} {length:7,} {len(found):7,} {visited:10,} {walk_ms:9.3f}"
                f" {per_state:9.2f} {decision_ms:12.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
