"""What a task waits for in the end is where its waits lead, one after the other; after every event of random lives."""

import re
from collections.abc import Iterable

from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import OVER
from tca_tools.why.last import Ends, causes, in_the_end
from tca_tools.why.leads import Kind, Node, leads, next_of
from tca_tools.why.waiting import why_waiting

_NUMBER = re.compile(r"\{(\d+)\}")


class FollowedPlayer(FoldedPlayer):
    """After every event all waits are followed to their ends."""

    def compare(self) -> None:
        at = RunAt(self.history)
        for task in at.tasks.values():
            if task.state not in OVER:
                assert_told(at, task.id)
                assert_ends(at, task.id)
        assert causes(at)[0] <= len(at.tasks)


def assert_told(at: RunAt, number: int) -> None:
    """Each step is one that the reasons name, by its number or, of a lock, by who has it."""
    told = " and ".join(why_waiting(at, at.tasks[number].id))
    named = {int(one) for one in _NUMBER.findall(told)}
    further = {one.number for one in leads(at, next_of(at, number))[0]} - named
    claims = {one for one in further if one in at.run.claims}
    assert all(at.run.claims[one].sender in told for one in claims), (number, told)
    assert " more" in told or not further - claims, (number, told, further)


def assert_ends(at: RunAt, number: int) -> None:
    """They are what can be reached and waits for nothing; if there is no such thing, a circle."""
    ends, seen = Ends.at(at).of(number), reached(at, [next_of(at, number)])
    last = {(kind, one.number) for one in seen for kind in leads(at, one)[1]}
    if ends[0].kind is Kind.CIRCLE:
        circle = Ends.at(at).circle(ends[0].number)
        assert any(one in reached(at, leads(at, one)[0]) for one in seen if one.number in circle)
    assert last == {(end.kind, end.number) for end in ends if end.kind is not Kind.CIRCLE}
    assert list(ends) == sorted(set(ends))
    last_one = next((end.number for end in ends if end.number != number), number)
    text = in_the_end(at, at.tasks[number])
    if text and ends[0].kind is not Kind.CIRCLE and last_one in at.run.messages:
        assert text.startswith(f"for {at.describe(last_one)}, which "), text


def reached(at: RunAt, start: Iterable[Node]) -> set[Node]:
    """All that waits lead to."""
    way = list(start)
    seen = set(way)
    for one in way:  # grows while it is walked
        new = [other for other in leads(at, one)[0] if other not in seen]
        way += new
        seen.update(new)
    return seen


@given(st.lists(operation, max_size=50))
@settings(max_examples=150)
def test_waits_lead_to_the_ends_that_are_told(operations: list[tuple[str, int, int, int, int]]) -> None:
    life = Life(FollowedPlayer())
    for name, *numbers in operations:
        life.do(name, *numbers)


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_the_same_in_a_long_life(seed: int) -> None:
    Life(FollowedPlayer()).go_on(seed, 400)
