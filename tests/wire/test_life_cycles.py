"""Life cycles as tables. The built-in life cycles match the figures of Lütkebohle et al. An
invalid table is refused when it is made.
"""

from collections.abc import Callable
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tca_wire.errors import BadFormat
from tca_wire.life_cycles import (
    BASIC,
    GENERAL,
    ONE_UPDATE,
    ROS_GOAL,
    Effect,
    LifeCycle,
    Transition,
    ending,
    read_life_cycle,
)
from tca_wire.messages.declarations import Command, Goal
from tca_wire.vocabulary import Outcome, Party

CLIENT, SERVER, BOTH = Party.CLIENT, Party.SERVER, Party.BOTH
ACCEPTED = Transition("accepted", "initiated", "running")
BEGIN = [ACCEPTED, Transition("rejected", "initiated", "cancelled")]
RUN = [*BEGIN, *ending("running")]
Row = tuple[str, str, str, Party]

FIGURE_2: set[Row] = {
    ("initiated", "accepted", "running", SERVER),
    ("initiated", "rejected", "cancelled", SERVER),
    ("initiated", "already done", "done", SERVER),
    ("running", "completed", "done", SERVER),
    ("running", "failed", "cancelled", SERVER),
}
ACTIVE = ("running", "update requested", "cancel requested")
FIGURE_10: set[Row] = {
    *FIGURE_2,
    ("running", "update", "update requested", CLIENT),
    ("update requested", "accept", "running", SERVER),
    ("update requested", "reject", "running", SERVER),
    ("running", "cancel", "cancel requested", CLIENT),
    ("cancel requested", "cancel failed", "running", SERVER),
    ("cancel requested", "aborted", "cancelled", SERVER),
    # The figure draws the next three at "Active".
    *((state, "result available", state, SERVER) for state in ACTIVE),
    *((state, "completed", "done", SERVER) for state in ACTIVE),
    *((state, "failed", "cancelled", SERVER) for state in ACTIVE),
}
MORE_THAN_THE_FIGURE: set[Row] = {
    ("initiated", "cancel", "cancel requested", CLIENT),
    ("update requested", "cancel", "cancel requested", CLIENT),
    ("update requested", "update", "update requested", CLIENT),
}
RCL_GOAL: set[Row] = {  # rcl_action, goal_state_machine.c
    ("accepted", "execute", "executing", SERVER),
    ("accepted", "cancel_goal", "canceling", CLIENT),
    ("executing", "cancel_goal", "canceling", CLIENT),
    ("executing", "succeed", "succeeded", SERVER),
    ("executing", "abort", "aborted", SERVER),
    ("canceling", "succeed", "succeeded", SERVER),
    ("canceling", "abort", "aborted", SERVER),
    ("canceling", "canceled", "canceled", SERVER),
}
REJECTION = {("canceling", "cancel_rejected", "executing", SERVER)}  # rcl never enters "canceling"
FEEDBACK = {(state, "feedback", state, SERVER) for state in ("executing", "canceling")}


def rows(life_cycle: LifeCycle) -> list[Row]:
    return [(one.source, one.name, one.target, one.by) for one in life_cycle.transitions]


def test_built_in_life_cycles_match_the_published_figures() -> None:
    assert sorted(rows(BASIC)) == sorted(FIGURE_2)
    assert sorted(rows(GENERAL)) == sorted(FIGURE_10 | MORE_THAN_THE_FIGURE)
    assert set(GENERAL.transitions) - set(ONE_UPDATE.transitions) == {
        GENERAL.steps["update requested", "update"]
    }
    assert sorted(rows(ROS_GOAL)) == sorted(RCL_GOAL | REJECTION | FEEDBACK)
    assert BASIC.active == ("running",)
    assert set(GENERAL.active) == set(ACTIVE)
    for one in (BASIC, GENERAL):
        assert (one.initial, one.done, one.cancelled) == ("initiated", "done", "cancelled")
        assert [state for state in one.states if one.is_over(state)] == ["done", "cancelled"]


@pytest.mark.parametrize("life_cycle", [BASIC, GENERAL, ROS_GOAL], ids=str)
def test_each_party_takes_only_its_own_transitions(life_cycle: LifeCycle) -> None:
    table = {(source, name): (target, by) for source, name, target, by in rows(life_cycle)}
    names = {name for _, name, _, _ in rows(life_cycle)}
    for state, name, party in product(life_cycle.states, names, (CLIENT, SERVER)):
        step = life_cycle.step(state, name, party)
        target, by = table.get((state, name), ("", Party.CENTRAL))
        assert (step.target if step else "") == (target if by is party else "")
        assert (state in life_cycle.sources(name, party)) == (step is not None)
        assert step is None or name in life_cycle.names(party)


def test_effects_belong_to_the_expected_transitions() -> None:
    with_effect = {(one.source, one.name): one.effect for one in GENERAL.transitions if one.effect}
    assert with_effect == {
        ("running", "update"): Effect.NEW_GOAL,
        ("update requested", "update"): Effect.NEW_GOAL,
        ("update requested", "accept"): Effect.TAKE_GOAL,
        ("update requested", "reject"): Effect.REFUSE,
        ("cancel requested", "cancel failed"): Effect.REFUSE,
        ("cancel requested", "aborted"): Effect.STOP,
        **{(state, "result available"): Effect.RESULT for state in ACTIVE},
    }
    assert not any(one.effect for one in BASIC.transitions)


def test_grant_and_refusal_of_a_client_request_are_found() -> None:
    grant, refusal = GENERAL.grant("update requested"), GENERAL.refusal("update requested")
    assert grant is not None
    assert refusal is not None
    assert (grant.name, refusal.name) == ("accept", "reject")
    failed = GENERAL.refusal("cancel requested")
    assert failed is not None
    assert failed.name == "cancel failed"
    assert GENERAL.grant("cancel requested") is None
    assert [state for state in GENERAL.states if GENERAL.ends_on_request(state)] == [
        "cancel requested"
    ]
    assert not any(
        BASIC.refusal(state) or BASIC.grant(state) or BASIC.ends_on_request(state)
        for state in BASIC.states
    )


DONE, FAILED, KILLED = Outcome.DONE, Outcome.FAILED, Outcome.KILLED
LOST = LifeCycle(
    "lost",
    [
        *RUN,
        Transition("skip", "running", "skipped"),
        Transition("hide", "running", "hidden", CLIENT),
        Transition("show", "hidden", "running"),
        Transition("module lost", "running", "lost"),
    ],
    done=["done", "skipped"],
    cancelled=["cancelled", "lost"],
)
ABORTED_FIRST = LifeCycle(
    "aborted first",
    ROS_GOAL.transitions,
    initial="accepted",
    done="succeeded",
    cancelled=["aborted", "canceled"],
)
HIDDEN = LifeCycle(
    "hidden",
    [
        *RUN,
        Transition("hide", "running", "hidden", CLIENT),
        Transition("dropped", "hidden", "dropped"),
    ],
    cancelled=["cancelled", "dropped"],
)


@pytest.mark.parametrize(
    ("cycle", "state", "outcome", "name", "way"),
    [
        (GENERAL, "running", DONE, "", "completed to done by server"),
        (GENERAL, "running", FAILED, "", "failed to cancelled by server"),
        (GENERAL, "running", KILLED, "", "killed to cancelled by central"),
        (GENERAL, "initiated", DONE, "", "already done to done by server"),
        (GENERAL, "initiated", FAILED, "", "rejected to cancelled by server"),
        (GENERAL, "cancel requested", KILLED, "", "aborted to cancelled by server"),
        (GENERAL, "cancel requested", FAILED, "", "failed to cancelled by server"),
        (LOST, "running", DONE, "skip", "skip to skipped by server"),
        (LOST, "running", DONE, "", "completed to done by server"),
        (LOST, "hidden", DONE, "skip", "skip to skipped by server"),
        (LOST, "running", FAILED, "module lost", "module lost to lost by server"),
        (LOST, "running", FAILED, "timeout", "failed to cancelled by server"),
        (LOST, "hidden", FAILED, "module lost", "failed to cancelled by central"),
        (LOST, "running", KILLED, "", "killed to cancelled by central"),
        (ROS_GOAL, "executing", FAILED, "abort", "abort to aborted by server"),
        (ROS_GOAL, "accepted", FAILED, "rejected", "failed to aborted by central"),
        (ROS_GOAL, "canceling", KILLED, "", "canceled to canceled by server"),
        (ROS_GOAL, "executing", KILLED, "", "killed to canceled by central"),
        (ABORTED_FIRST, "accepted", KILLED, "", "killed to canceled by central"),
        (ABORTED_FIRST, "executing", KILLED, "", "killed to canceled by central"),
        (HIDDEN, "hidden", KILLED, "", "killed to dropped by central"),
        (ROS_GOAL, "canceling", DONE, "", "succeed to succeeded by server"),
    ],
)
def test_end_follows_from_state_and_outcome(
    cycle: LifeCycle, state: str, outcome: Outcome, name: str, way: str
) -> None:
    end = cycle.end(state, outcome, name)
    assert f"{end.name} to {end.target} by {end.by}" == way


PAUSE = [
    Transition("pause", "running", "paused", CLIENT),
    Transition("resume", "paused", "running", CLIENT),
]
STRANGE: Any = "strange"


def test_invalid_life_cycle_is_refused_with_a_reason(approve: Callable[..., None]) -> None:
    def refusal(case: str) -> str:
        with pytest.raises(BadFormat) as error:
            LifeCycle("odd", eval(case))
        return str(error.value)

    approve("bad_tables.txt", refusal)


def test_initial_done_and_cancelled_states_must_differ() -> None:
    for same in (
        {"done": "over", "cancelled": "over"},
        {"done": "initiated"},
        {"initial": "cancelled"},
    ):
        with pytest.raises(BadFormat, match="its initial state and its final states must differ"):
            LifeCycle("odd", RUN, **same)
    with pytest.raises(BadFormat, match="not a name"):
        LifeCycle("", RUN)
    with pytest.raises(BadFormat, match="at least one state as done="):
        LifeCycle("odd", RUN, done=())
    with pytest.raises(BadFormat, match="'skipped' can't be reached"):
        LifeCycle("odd", RUN, done=("done", "skipped"))


def test_initial_and_final_states_can_be_renamed() -> None:
    own = LifeCycle(
        "polite",
        [
            Transition("begin", "asked", "at work"),
            *ending("at work", done="thanked", cancelled="sorry"),
        ],
        initial="asked",
        done="thanked",
        cancelled="sorry",
    )
    assert own.states == ("asked", "at work", "thanked", "sorry")
    assert (own.active, own.accepted.name) == (("at work",), "begin")
    assert [own.is_over(state) for state in own.states] == [False, False, True, True]


def test_life_cycle_survives_its_declaration() -> None:
    pausable = LifeCycle("pausable", [*GENERAL.transitions, *PAUSE, *ending("paused")])
    assert read_life_cycle(Command("grasp", life_cycle=pausable).format.life_cycle) == pausable
    assert read_life_cycle(Goal("tidy", life_cycle=BASIC).format.life_cycle) == BASIC
    assert Command("grasp").format.life_cycle == ""  # as in older journals and packets
    assert read_life_cycle("") is GENERAL
    assert read_life_cycle(GENERAL.text) == GENERAL
    assert read_life_cycle(Command("dig", life_cycle=LOST).format.life_cycle) == LOST
    others = [
        BASIC,
        pausable,
        LifeCycle("pausable", GENERAL.transitions),
        LifeCycle("general", BASIC.transitions),
    ]
    assert len({GENERAL, *others}) == 5


@pytest.mark.parametrize(
    "text",
    [
        "nonsense",
        "[]",
        '["odd","initiated","done","cancelled"]',
        '["odd","a","b","c",[["x"]]]',
        "[" * 100_000,
    ],
)
def test_malformed_life_cycle_text_is_refused(text: str) -> None:
    with pytest.raises(BadFormat, match="not the table of a life cycle"):
        read_life_cycle(text)


def test_message_accepts_only_a_life_cycle_object() -> None:
    for odd in ("general", None, GENERAL.transitions):
        with pytest.raises(
            BadFormat,
            match="the life cycle of command 'grasp' must be a LifeCycle, such as GENERAL, not",
        ):
            Command("grasp", life_cycle=odd)  # type: ignore[call-overload]


ALIVE = ["initiated", "running", "paused", "asleep"]
STATES = st.sampled_from([*ALIVE, "done", "cancelled"])
NAMES, PARTIES = st.sampled_from("abcdef"), st.sampled_from([CLIENT, SERVER, BOTH])
TRANSITIONS = st.builds(Transition, NAMES, st.sampled_from(ALIVE) | STATES, STATES, PARTIES)


@given(st.lists(TRANSITIONS, max_size=5))
def test_life_cycle_is_refused_exactly_when_tasks_could_not_end(more: list[Transition]) -> None:
    """The test checks the rules in another way: it follows all transitions from each state."""
    table = [
        ACCEPTED,
        Transition("completed", "running", "done"),
        Transition("failed", "running", "cancelled"),
        *more,
    ]

    def reached(start: str, *, by_client: bool) -> set[str]:
        met = {start}
        for _ in range(5):
            met |= {
                one.target
                for one in table
                if one.source in met and (by_client or one.by is not CLIENT)
            }
        return met

    states = {"initiated", "done", "cancelled"} | {one.target for one in table}
    wrong = (
        len({(one.source, one.name) for one in table}) < len(table)
        or any(one.source in ("done", "cancelled") for one in table)
        or any(one.by is not SERVER and one.target in ("done", "cancelled") for one in table)
        or reached("initiated", by_client=True) < states | {one.source for one in table}
        or any(not reached(state, by_client=False) & {"done", "cancelled"} for state in states)
    )
    try:
        life_cycle = LifeCycle("random", table)
    except BadFormat:
        assert wrong
    else:
        assert not wrong
        assert read_life_cycle(life_cycle.text) == life_cycle
