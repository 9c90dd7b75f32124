"""Life cycles of tasks: the states of a task that its clients see, and the allowed transitions.

After Lütkebohle et al., "The Task-State Pattern". ``BASIC`` is figure 2. ``GENERAL`` is figure 10,
the default for goals and commands. ``ROS_GOAL`` is the table of ROS 2. A life cycle has one initial
state and any number of final states. Each final state counts as done, or as cancelled.
"""

import json
from collections.abc import Iterable, Sequence
from enum import StrEnum
from functools import lru_cache

import msgspec

from tca_wire.errors import BadFormat
from tca_wire.vocabulary import Outcome, Party, is_name

MOST_TRANSITIONS = 100


class Effect(StrEnum):
    """The effect of a transition in central, beside the change of state.

    Attributes:
        NONE: none.
        NEW_GOAL: by the client: the data is a new goal, which the server may accept.
        TAKE_GOAL: by the server: the client's new goal is now the task's.
        REFUSE: by the server: the client's request is refused.
        RESULT: by the server: the data is an intermediate result.
        STOP: by the server: the task ends at the client's request.
    """

    NONE = ""
    NEW_GOAL = "new goal"
    TAKE_GOAL = "take goal"
    REFUSE = "refuse"
    RESULT = "result"
    STOP = "stop"


class Transition(msgspec.Struct, frozen=True, array_like=True):
    """A row of the table: from state *source* to state *target*, taken by the party *by*."""

    name: str
    source: str
    target: str
    by: Party = Party.SERVER
    effect: Effect = Effect.NONE


class LifeCycle:
    """The states and transitions of a task.

    Args:
        name: the name of the life cycle, for errors.
        transitions: the rows of the table. Parties: client, server or both.
        initial: the state of a task before a handler has accepted it.
        done: the final state of a task that has completed; or several, the usual one first.
        cancelled: the final state of a task that has ended without completion; or several. A killed
            task takes the end of the nearest transition with ``Effect.STOP``; without one, the
            first of these that its state can reach.

    Raises:
        BadFormat: the table is not usable: a state can't be reached, or can't reach an end.

    Example::

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
        done: str | Sequence[str] = "done",
        cancelled: str | Sequence[str] = "cancelled",
    ) -> None:
        self.name, self.initial = name, initial
        self.successes = (done,) if isinstance(done, str) else tuple(done)
        self.failures = (cancelled,) if isinstance(cancelled, str) else tuple(cancelled)
        self.has_many_ends = len(self.successes) + len(self.failures) > 2
        self.transitions = tuple(transitions)
        for row in self.transitions:
            if not isinstance(row, Transition):
                self._refuse(f"{row!r:.40} is not a Transition")
        named = [state for row in self.transitions for state in (row.source, row.target)]
        self.states = tuple(dict.fromkeys([initial, *named, *self.successes, *self.failures]))
        self.steps = {(row.source, row.name): row for row in self.transitions}
        self._check()
        self.accepted = next(row for row in self.transitions if self._accepts(row))
        """The transition that a task takes when a handler starts with it."""

    def __repr__(self) -> str:
        return f"life cycle '{self.name}'"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LifeCycle) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    @property
    def done(self) -> str:
        """The usual final state of a task that has completed."""
        return self.successes[0]

    @property
    def cancelled(self) -> str:
        """The usual final state of a task that has ended without completion."""
        return self.failures[0]

    @property
    def active(self) -> tuple[str, ...]:
        """The states of a task that was accepted and has not ended."""
        return tuple(
            state for state in self.states if state != self.initial and not self.is_over(state)
        )

    def is_over(self, state: str) -> bool:
        """Return whether a state is final."""
        return state in self.successes or state in self.failures

    def step(self, state: str, name: str, by: Party) -> Transition | None:
        """Return the transition of that name out of *state*, if that party may take it."""
        found = self.steps.get((state, name))
        return found if found is not None and found.by in (by, Party.BOTH) else None

    def sources(self, name: str, by: Party) -> list[str]:
        """Return the states in which that party may take the transition of that name."""
        return [
            row.source
            for row in self.transitions
            if row.name == name and row.by in (by, Party.BOTH)
        ]

    def names(self, by: Party) -> list[str]:
        """Return the transitions that a party may take in some state."""
        return list(
            dict.fromkeys(row.name for row in self.transitions if row.by in (by, Party.BOTH))
        )

    def end(self, state: str, outcome: Outcome, name: str = "") -> Transition:
        """Return the transition by which a task ends.

        If the table has none for the outcome, central ends the task, and the party is ``CENTRAL``.

        Args:
            state: the last state of the task.
            outcome: how the task ended.
            name: the transition that the handler has chosen, or the name of the task's failure.
        """
        is_success, is_kill = outcome.lets_successors_continue, outcome is Outcome.KILLED
        ends = self.successes if is_success else self.failures
        if outcome is Outcome.RESOLVED:  # central ends it, so no row of the table applies
            return Transition(str(outcome), state, ends[0])
        # A kill takes the row of a client's cancel (STOP); other failures take other rows.
        rows = [
            row
            for row in self.transitions
            if row.target in ends and (is_success or (row.effect is Effect.STOP) is is_kill)
        ]
        here = [row for row in rows if row.source == state]
        # A client's request may have changed the state since the handler has chosen its end.
        choices = here + rows if is_success else here
        if found := [row for row in choices if row.name == name] or here:
            return found[0]
        if is_kill:
            return Transition(str(outcome), state, self._killed_end(state), Party.CENTRAL)
        target = ends[0] if is_success or not rows else rows[0].target
        return Transition("completed" if is_success else str(outcome), state, target, Party.CENTRAL)

    def _killed_end(self, state: str) -> str:
        """Return the final state of a task that is killed in *state*, which has no ``STOP``.

        That is the end of the nearest ``STOP`` that transitions from *state* lead to; without one,
        the first end of a killed task that they lead to.
        """
        ahead = [state]
        for source in ahead:  # it grows
            if (stop := self._with_effect(source, Effect.STOP)) is not None:
                return stop.target
            targets = [row.target for row in self.transitions if row.source == source]
            ahead += [one for one in targets if one not in ahead]
        return next((one for one in self.failures if one in ahead), self.cancelled)

    def completion(self, states: Iterable[str], name: str = "") -> Transition | None:
        """Return the transition by which a handler completes a task in the first possible state.

        With a *name*, only the transition of that name counts. The result is None if no transition
        completes a task in any of *states*.
        """
        rows = [row for row in self.transitions if row.target in self.successes]
        rows = [row for row in rows if name in ("", row.name)]
        return next((row for state in states for row in rows if row.source == state), None)

    def is_pending(self, state: str, name: str) -> bool:
        """Return whether a task in *state* waits for an answer to a client's transition *name*."""
        asked = (row for row in self.transitions if (row.name, row.target) == (name, state))
        return any(row.by is Party.CLIENT for row in asked) and bool(
            self.grant(state) or self.refusal(state) or self.ends_on_request(state)
        )

    def refusal(self, state: str) -> Transition | None:
        """Return the transition by which the server refuses a client's request."""
        return self._with_effect(state, Effect.REFUSE)

    def why_no_refusal(self, state: str) -> str:
        """Return why no request can be rejected in *state*, and the remedy."""
        row = f"Transition(..., '{state}', ..., effect=Effect.REFUSE)"
        return f"{self} has no transition for that: add {row} to its table"

    def grant(self, state: str) -> Transition | None:
        """Return the transition by which the server accepts a client's new goal."""
        return self._with_effect(state, Effect.TAKE_GOAL)

    def ends_on_request(self, state: str) -> bool:
        """Return whether the server may end the task in this state at a client's request."""
        return self._with_effect(state, Effect.STOP) is not None

    def _with_effect(self, state: str, effect: Effect) -> Transition | None:
        """Return the first transition out of *state* that has this effect."""
        rows = (row for row in self.transitions if row.source == state)
        return next((row for row in rows if row.effect is effect), None)

    def cancel(self, state: str) -> Transition | None:
        """Return the transition by which a client requests the end of the task."""
        rows = (row for row in self.transitions if row.source == state and row.by is Party.CLIENT)
        return next((row for row in rows if self.ends_on_request(row.target)), None)

    @property
    def text(self) -> str:
        """The table as text, by which central compares the declarations of a message."""
        rows = json.loads(msgspec.json.encode(self.transitions))
        ends = [one[0] if len(one) == 1 else list(one) for one in (self.successes, self.failures)]
        return json.dumps([self.name, self.initial, *ends, rows], separators=(",", ":"))

    # --- checks -----------------------------------------------------------------------------------

    def _accepts(self, row: Transition) -> bool:
        """Return whether the server accepts a new task by this transition."""
        is_first = row.source == self.initial and row.target in self.active
        return is_first and row.by is not Party.CLIENT and not row.effect

    def _check(self) -> None:
        for name in (self.name, *self.states, *(row.name for row in self.transitions)):
            if not isinstance(name, str) or not is_name(name):
                self._refuse(f"{name!r:.40} is not a name: use a few printable characters")
        if len(self.transitions) > MOST_TRANSITIONS:
            number = len(self.transitions)
            self._refuse(f"it has {number} transitions: at most {MOST_TRANSITIONS} are allowed")
        if not (self.successes and self.failures):
            self._refuse("give at least one state as done=, and one as cancelled=")
        special = (self.initial, *self.successes, *self.failures)
        if len(set(special)) < len(special):
            self._refuse("its initial state and its final states must differ")
        if len(self.steps) < len(self.transitions):
            rows = [(row.source, row.name) for row in self.transitions]
            repeated = next(row for at, row in enumerate(self.transitions) if rows[at] in rows[:at])
            self._refuse(
                f"'{repeated.name}' leaves '{repeated.source}' twice:"
                " give each transition of a state its own name"
            )
        for row in self.transitions:
            self._check_row(row)
        if not any(self._accepts(row) for row in self.transitions):
            self._refuse(
                f"no transition of the server leads from '{self.initial}'"
                " to a state in which the task runs"
            )
        self._check_reachability()

    def _check_row(self, row: Transition) -> None:
        where = f"'{row.name}' from '{row.source}'"
        if self.is_over(row.source):
            self._refuse(f"{where}: no transition may leave a final state")
        if row.by not in (Party.CLIENT, Party.SERVER, Party.BOTH) or not isinstance(row.by, Party):
            self._refuse(
                f"{where}: its party must be Party.CLIENT, SERVER or BOTH, not {row.by!r:.40}"
            )
        if not isinstance(row.effect, Effect):
            self._refuse(f"{where}: {row.effect!r:.40} is not an Effect")
        wanted = Party.CLIENT if row.effect is Effect.NEW_GOAL else Party.SERVER
        if row.effect and row.by is not wanted:
            self._refuse(
                f"{where}: only the {wanted} may take a transition with the effect '{row.effect}'"
            )
        if row.by is not Party.SERVER and self.is_over(row.target):
            self._refuse(
                f"{where}: only the server may end a task: lead to a state that the server leaves"
            )
        if row.effect is Effect.STOP and row.target not in self.failures:
            ends = " or ".join(f"'{end}'" for end in self.failures)
            self._refuse(f"{where}: with the effect 'stop' it must lead to {ends}")

    def _check_reachability(self) -> None:
        reached = _reachable([self.initial], [(row.source, row.target) for row in self.transitions])
        if lost := [state for state in self.states if state not in reached]:
            self._refuse(f"'{lost[0]}' can't be reached from '{self.initial}'")
        reversed_arrows = [
            (row.target, row.source) for row in self.transitions if row.by is not Party.CLIENT
        ]
        can_end = _reachable([*self.successes, *self.failures], reversed_arrows)
        if stuck := [state for state in self.states if state not in can_end]:
            self._refuse(
                f"the server can't end a task that is '{stuck[0]}':"
                " add transitions to an end, see ending()"
            )

    def _refuse(self, why: str) -> None:
        raise BadFormat(f"life cycle {self.name!r:.40} is not valid: {why}")


def _reachable(start: list[str], arrows: list[tuple[str, str]]) -> set[str]:
    targets: dict[str, list[str]] = {}
    for source, target in arrows:
        targets.setdefault(source, []).append(target)
    reached, new = set(start), list(start)
    while new:
        for target in targets.get(new.pop(), ()):
            if target not in reached:
                reached.add(target)
                new.append(target)
    return reached


def ending(*states: str, done: str = "done", cancelled: str = "cancelled") -> list[Transition]:
    """Return the rows by which the server ends a task.

    Completion leads to *done*, failure to *cancelled*.

    Args:
        states: the states in which the task can end.
        done: the final state of a completed task. Default: "done".
        cancelled: the final state of a failed task. Default: "cancelled".

    Returns:
        Two rows for each state.

    Example::

        PAUSABLE = LifeCycle("pausable", [*GENERAL.transitions, *ending("paused")])
    """
    return [
        row
        for state in states
        for row in (Transition("completed", state, done), Transition("failed", state, cancelled))
    ]


def read_life_cycle(text: str) -> LifeCycle:
    """Read the life cycle of a declaration; "" is ``GENERAL``. Raises BadFormat."""
    return _read(text) if text else GENERAL


@lru_cache(maxsize=256)  # bounded: modules send any number of texts
def _read(text: str) -> LifeCycle:
    try:
        name, initial, done, cancelled, rows = msgspec.json.decode(
            text, type=tuple[str, str, str | list[str], str | list[str], list[Transition]]
        )
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadFormat(f"not the table of a life cycle: {error}") from None
    return LifeCycle(name, rows, initial=initial, done=done, cancelled=cancelled)


def _first_transitions() -> list[Transition]:
    return [
        Transition("accepted", "initiated", "running"),
        Transition("already done", "initiated", "done"),
        Transition("rejected", "initiated", "cancelled"),
    ]


BASIC = LifeCycle("basic", [*_first_transitions(), *ending("running")])
"""Figure 2: a task is requested, accepted or rejected, and ends."""

GENERAL = LifeCycle(
    "general",
    [
        *_first_transitions(),
        *(
            Transition("update", state, "update requested", Party.CLIENT, Effect.NEW_GOAL)
            for state in ("running", "update requested")
        ),
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
"""Figure 10: a running task can also be cancelled and get a new goal, and has intermediate results.

A client may cancel a task before it is accepted: an early cancel must not be lost. If updates come
faster than the handler answers them, the newest wins.
"""

ONE_UPDATE = LifeCycle(
    "one update",
    [
        row
        for row in GENERAL.transitions
        if (row.source, row.name) != ("update requested", "update")
    ],
)
"""As ``GENERAL``, but an update is refused while another one is pending: the oldest wins."""

ROS_GOAL = LifeCycle(
    "ros goal",
    [
        Transition("execute", "accepted", "executing"),
        Transition("cancel_goal", "accepted", "canceling", Party.CLIENT),
        Transition("cancel_goal", "executing", "canceling", Party.CLIENT),
        Transition("succeed", "executing", "succeeded"),
        Transition("succeed", "canceling", "succeeded"),
        Transition("abort", "executing", "aborted"),
        Transition("abort", "canceling", "aborted"),
        Transition("canceled", "canceling", "canceled", Party.SERVER, Effect.STOP),
        Transition("cancel_rejected", "canceling", "executing", Party.SERVER, Effect.REFUSE),
        *(
            Transition("feedback", state, state, Party.SERVER, Effect.RESULT)
            for state in ("executing", "canceling")
        ),
    ],
    initial="accepted",
    done="succeeded",
    cancelled=["canceled", "aborted"],
)
"""The states of a goal of ROS 2 (rcl_action), feedback, and the rejection of a cancel; no updates.

rcl enters "canceling" when the server accepts a cancel. Here the client's request does.
"""
