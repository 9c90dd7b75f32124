"""Life cycles of tasks, as tables: the states that client and server of a task see, and who may
take which transition.

After Lütkebohle et al., "The Task-State Pattern": figure 2 is ``BASIC``, figure 10 is ``GENERAL``,
which every goal and command has that is declared with no other. What they all share is a beginning,
and two ends: *done* and *cancelled*.
"""

import json
from collections.abc import Iterable
from enum import StrEnum
from functools import lru_cache

import msgspec

from tca_wire.errors import BadFormat
from tca_wire.vocabulary import Outcome, Party, is_name

MOST_TRANSITIONS = 100


class Effect(StrEnum):
    """What central does with a transition, beside the change of state."""

    NONE = ""
    NEW_GOAL = "new goal"  # the client's: its data are a goal that the server may take over
    TAKE_GOAL = "take goal"  # the server's: that goal is the task's from now on
    REFUSE = "refuse"  # the server's: the client's request is refused
    RESULT = "result"  # the server's: its data are an intermediate result
    STOP = "stop"  # the server's: the task ends as the client wanted


class Transition(msgspec.Struct, frozen=True, array_like=True):
    """A row of the table: from the state *source* to *target*, by whom."""

    name: str
    source: str
    target: str
    by: Party = Party.SERVER
    effect: Effect = Effect.NONE


class LifeCycle:
    """The states and transitions of a task. Raises BadFormat for a table that no task could go by.

    ::

        PAUSABLE = LifeCycle("pausable", [
            *GENERAL.transitions,
            Transition("pause", "running", "paused", Party.CLIENT),
            Transition("resume", "paused", "running", Party.CLIENT),
            *ending("paused"),
        ])
    """

    def __init__(
        self,
        name: str,
        transitions: Iterable[Transition],
        *,
        initial: str = "initiated",
        done: str = "done",
        cancelled: str = "cancelled",
    ) -> None:
        self.name, self.initial, self.done, self.cancelled = name, initial, done, cancelled
        self.transitions = tuple(transitions)
        for row in self.transitions:
            if not isinstance(row, Transition):
                self._refuse(f"{row!r:.40} is not a Transition")
        met = [state for one in self.transitions for state in (one.source, one.target)]
        self.states = tuple(dict.fromkeys([initial, *met, done, cancelled]))
        self.steps = {(one.source, one.name): one for one in self.transitions}
        self._check()
        self.accepted = next(one for one in self.transitions if self._accepts(one))
        """The transition that a task takes when a handler begins with it."""

    def __repr__(self) -> str:
        return f"life cycle '{self.name}'"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LifeCycle) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    @property
    def active(self) -> tuple[str, ...]:
        """The states of a task that has been accepted and has not ended."""
        return tuple(
            state for state in self.states if state not in (self.initial, self.done, self.cancelled)
        )

    def is_over(self, state: str) -> bool:
        """Whether that state is an end."""
        return state in (self.done, self.cancelled)

    def step(self, state: str, name: str, by: Party) -> Transition | None:
        """The transition of that name out of *state*, if that party may take it."""
        found = self.steps.get((state, name))
        return found if found is not None and found.by in (by, Party.BOTH) else None

    def sources(self, name: str, by: Party) -> list[str]:
        """The states in which that party may take the transition of that name."""
        return [
            one.source
            for one in self.transitions
            if one.name == name and one.by in (by, Party.BOTH)
        ]

    def names(self, by: Party) -> list[str]:
        """The transitions that a party may take in some state."""
        return list(
            dict.fromkeys(one.name for one in self.transitions if one.by in (by, Party.BOTH))
        )

    def ending(self, state: str, end: str, outcome: Outcome) -> str:
        """The name of the transition from *state* to that *end*: the first in the table that fits
        the outcome.
        """
        if outcome is Outcome.RESOLVED:  # that is no way that its server takes
            return str(outcome)
        rows = (one for one in self.transitions if (one.source, one.target) == (state, end))
        is_kill = (
            outcome is Outcome.KILLED
        )  # only a kill takes the way of a client's cancel, and no other
        ways = [
            one.name for one in rows if end == self.done or (one.effect is Effect.STOP) is is_kill
        ]
        return ways[0] if ways else ("completed" if end == self.done else str(outcome))

    def refusal(self, state: str) -> Transition | None:
        """The transition by which the server refuses what a client has asked for."""
        return next(
            (
                one
                for one in self.transitions
                if one.source == state and one.effect is Effect.REFUSE
            ),
            None,
        )

    def grant(self, state: str) -> Transition | None:
        """The transition by which the server takes over the goal that a client has asked for."""
        return next(
            (
                one
                for one in self.transitions
                if one.source == state and one.effect is Effect.TAKE_GOAL
            ),
            None,
        )

    def ends_on_request(self, state: str) -> bool:
        """Whether the server may end the task out of this state because a client wants that."""
        return any(one.source == state and one.effect is Effect.STOP for one in self.transitions)

    def cancel(self, state: str) -> Transition | None:
        """The transition by which a client asks for the end of the task."""
        rows = (one for one in self.transitions if one.source == state and one.by is Party.CLIENT)
        return next((one for one in rows if self.ends_on_request(one.target)), None)

    @property
    def text(self) -> str:
        """The table as text, by which central compares the declarations of a message."""
        rows = json.loads(msgspec.json.encode(self.transitions))
        return json.dumps(
            [self.name, self.initial, self.done, self.cancelled, rows], separators=(",", ":")
        )

    # --- checks -----------------------------------------------------------------------------------

    def _accepts(self, one: Transition) -> bool:
        is_first = (
            one.source == self.initial
            and not self.is_over(one.target)
            and one.target != self.initial
        )
        return is_first and one.by is not Party.CLIENT and not one.effect

    def _check(self) -> None:
        for name in (self.name, *self.states, *(one.name for one in self.transitions)):
            if not isinstance(name, str) or not is_name(name):
                self._refuse(f"{name!r:.40} is not a name: use a few printable characters")
        if len(self.transitions) > MOST_TRANSITIONS:
            self._refuse(
                f"it has {len(self.transitions)} transitions: at most {MOST_TRANSITIONS} are allowed"
            )
        if len({self.initial, self.done, self.cancelled}) < 3:
            self._refuse("its initial state and its two final states must differ")
        if len(self.steps) < len(self.transitions):
            rows = [(one.source, one.name) for one in self.transitions]
            double = next(one for at, one in enumerate(self.transitions) if rows[at] in rows[:at])
            self._refuse(
                f"'{double.name}' leaves '{double.source}' twice: give each transition of a state its own name"
            )
        for one in self.transitions:
            self._check_row(one)
        if not any(self._accepts(one) for one in self.transitions):
            self._refuse(
                f"no transition of the server leads from '{self.initial}' to a state in which the task runs"
            )
        self._check_ways()

    def _check_row(self, one: Transition) -> None:
        where = f"'{one.name}' from '{one.source}'"
        if self.is_over(one.source):
            self._refuse(f"{where}: no transition may leave a final state")
        if one.by not in (Party.CLIENT, Party.SERVER, Party.BOTH) or not isinstance(one.by, Party):
            self._refuse(
                f"{where}: its party must be Party.CLIENT, SERVER or BOTH, not {one.by!r:.40}"
            )
        if not isinstance(one.effect, Effect):
            self._refuse(f"{where}: {one.effect!r:.40} is not an Effect")
        wanted = Party.CLIENT if one.effect is Effect.NEW_GOAL else Party.SERVER
        if one.effect and one.by is not wanted:
            self._refuse(
                f"{where}: only the {wanted} may take a transition with the effect '{one.effect}'"
            )
        if one.by is not Party.SERVER and self.is_over(one.target):
            self._refuse(
                f"{where}: only the server may end a task: lead to a state that the server leaves"
            )
        if one.effect is Effect.STOP and one.target != self.cancelled:
            self._refuse(f"{where}: with the effect 'stop' it must lead to '{self.cancelled}'")

    def _check_ways(self) -> None:
        met = _reachable([self.initial], [(one.source, one.target) for one in self.transitions])
        if lost := [state for state in self.states if state not in met]:
            self._refuse(f"'{lost[0]}' can't be reached from '{self.initial}'")
        backwards = [
            (one.target, one.source) for one in self.transitions if one.by is not Party.CLIENT
        ]
        can_end = _reachable([self.done, self.cancelled], backwards)
        if stuck := [state for state in self.states if state not in can_end]:
            self._refuse(
                f"the server can't end a task that is '{stuck[0]}': add transitions to an end, see ending()"
            )

    def _refuse(self, why: str) -> None:
        raise BadFormat(f"life cycle {self.name!r:.40} is not valid: {why}")


def _reachable(start: list[str], arrows: list[tuple[str, str]]) -> set[str]:
    targets: dict[str, list[str]] = {}
    for source, target in arrows:
        targets.setdefault(source, []).append(target)
    met, new = set(start), list(start)
    while new:
        for target in targets.get(new.pop(), ()):
            if target not in met:
                met.add(target)
                new.append(target)
    return met


def ending(*states: str, done: str = "done", cancelled: str = "cancelled") -> list[Transition]:
    """The rows by which the server ends a task that is in one of these states: completed, or
    failed.
    """
    return [
        row
        for state in states
        for row in (Transition("completed", state, done), Transition("failed", state, cancelled))
    ]


def read_life_cycle(text: str) -> LifeCycle:
    """The life cycle of a declaration; "" is ``GENERAL``. Raises BadFormat."""
    return _read(text) if text else GENERAL


@lru_cache(maxsize=256)  # of any module's texts
def _read(text: str) -> LifeCycle:
    try:
        name, initial, done, cancelled, rows = msgspec.json.decode(
            text, type=tuple[str, str, str, str, list[Transition]]
        )
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadFormat(f"not the table of a life cycle: {error}") from None
    return LifeCycle(name, rows, initial=initial, done=done, cancelled=cancelled)


def _begin() -> list[Transition]:
    return [
        Transition("accepted", "initiated", "running"),
        Transition("already done", "initiated", "done"),
        Transition("rejected", "initiated", "cancelled"),
    ]


BASIC = LifeCycle("basic", [*_begin(), *ending("running")])
"""Figure 2: a task is asked for, accepted or rejected, and ends."""

GENERAL = LifeCycle(
    "general",
    [
        *_begin(),
        Transition("update", "running", "update requested", Party.CLIENT, Effect.NEW_GOAL),
        Transition("accept", "update requested", "running", Party.SERVER, Effect.TAKE_GOAL),
        Transition("reject", "update requested", "running", Party.SERVER, Effect.REFUSE),
        *(
            Transition("cancel", state, "cancel requested", Party.CLIENT)
            for state in ("initiated", "running", "update requested")
        ),
        Transition("aborted", "cancel requested", "cancelled", Party.SERVER, Effect.STOP),
        Transition("cancel failed", "cancel requested", "running", Party.SERVER, Effect.REFUSE),
        *(
            Transition("result available", state, state, Party.SERVER, Effect.RESULT)
            for state in ("running", "update requested", "cancel requested")
        ),
        *ending("running", "update requested", "cancel requested"),
    ],
)
"""Figure 10: also the goal of a running task may be changed, it may be cancelled, and there are
intermediate results. A task may be cancelled before it is accepted, too: a cancel must not be lost
because it came early.
"""
