"""Messages ahead, in every order: what is recalled is not begun, and all comes out as it could
without.
"""

from collections.abc import Callable
from typing import Any

import pytest
from explore import with_ahead as ahead
from explore.scenarios import good
from explore.with_ahead import Street
from msgspec.structs import replace

import tca_tools.explore as tca
from dev.invariants import check_invariants
from tca_central.model.resources import Resource
from tca_central.order.ahead import MessagesAhead
from tca_module.session import joined_replies
from tca_module.session.session import Session
from tca_tools.explore import never_stuck
from tca_tools.explore.search.states import Violation
from tca_wire.packets import headers

Patch = pytest.MonkeyPatch
Make = Callable[[int | None], Street]


def compared(make: Make) -> tca.Result:
    """The runs with two messages ahead; what comes of one and of none without is a violation."""
    without = good(make(0).scenario, never_stuck())
    result = tca.explore(make(2).scenario, never_stuck(), check=check_invariants)
    new = [
        actions for outcome, actions in result.outcomes.items() if outcome not in without.outcomes
    ]
    if not new:
        return result
    return replace(
        result, violation=Violation("as without", "this could not have happened", min(new, key=len))
    )


@pytest.mark.parametrize(
    "make", [*ahead.SMALL, *(pytest.param(make, marks=pytest.mark.soak) for make in ahead.LARGE)]
)
def test_outcomes_with_prefetch_equal_outcomes_without(make: Make) -> None:
    result = compared(make)
    assert result.ok, tca.report(result)


@pytest.mark.soak
@pytest.mark.parametrize("make", ahead.UNLIKE)
def test_prefetched_message_is_neither_repeated_nor_lost(make: Make) -> None:
    good(make(2).scenario, never_stuck())


# --- faults ---------------------------------------------------------------------------------------


def nobody_waits_for_what_is_given_back(patch: Patch) -> None:
    def recall(self: MessagesAhead, resource: Any) -> None:
        if resource.ahead:
            self._out.recall(resource.ahead_at)

    patch.setattr(MessagesAhead, "recall", recall)


def what_is_recalled_is_begun(patch: Patch) -> None:
    def give_back(self: Session, _: object = None) -> None:
        self.post(headers.Recalled([header.delivery for header, _ in self.ahead]))

    patch.setattr(Session, "give_back", give_back)


def what_is_recalled_is_lost(patch: Patch) -> None:
    real = Session.give_back

    def give_back(self: Session, wanted: Any = None) -> None:
        real(self, wanted)
        self.outgoing[-1] = headers.Recalled([]), b""

    patch.setattr(Session, "give_back", give_back)


def the_next_is_begun_before_an_answer(patch: Patch) -> None:
    patch.setattr(Session, "has_next", property(lambda self: bool(self.ahead)))


def what_is_given_back_is_turned_round(patch: Patch) -> None:
    real = Resource.take_back

    def take_back(self: Resource[Any, Any], message: Any) -> object:
        message.arrival = 1000 - message.arrival
        return real(self, message)

    patch.setattr(Resource, "take_back", take_back)


def the_last_of_several_replies_is_cut_off(patch: Patch) -> None:
    def together(runs: list[Any], bodies: list[bytes], begun: float) -> tuple[Any, bytes]:
        return headers.Replies(runs[:0:-1] or runs, begun), b"".join(bodies[:0:-1] or bodies)

    patch.setattr(joined_replies, "_join", together)


FAULTS: dict[Callable[[Patch], None], tuple[Make, str]] = {
    nobody_waits_for_what_is_given_back: (ahead.locked, "central's own invariants"),
    what_is_recalled_is_begun: (ahead.overtaken, "what central promises"),
    what_is_recalled_is_lost: (ahead.overtaken, "what central promises"),
    the_next_is_begun_before_an_answer: (ahead.overtaken, "central's own invariants"),
    the_last_of_several_replies_is_cut_off: (ahead.locked_elsewhere, "what central promises"),
    what_is_given_back_is_turned_round: (ahead.locked_elsewhere, "as without"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_of_prefetching_is_found(fault: Callable[[Patch], None], monkeypatch: Patch) -> None:
    make, broken = FAULTS[fault]
    fault(monkeypatch)
    result = compared(make)
    assert result.violation is not None
    assert result.violation.broken == broken
