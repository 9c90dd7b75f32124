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
from tca_central.order.prefetching import Prefetcher
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
def test_all_comes_out_as_without(make: Make) -> None:
    result = compared(make)
    assert result.ok, tca.report(result)


@pytest.mark.soak
@pytest.mark.parametrize("make", ahead.UNLIKE)
def test_nothing_is_begun_twice_or_lost(make: Make) -> None:
    good(make(2).scenario, never_stuck())


# --- faults ---------------------------------------------------------------------------------------


def nobody_waits_for_what_is_given_back(patch: Patch) -> None:
    def recall(self: Prefetcher, resource: Any) -> None:
        if resource.prefetched:
            self._out.recall(resource.prefetching_slot)

    patch.setattr(Prefetcher, "recall", recall)


def what_is_recalled_is_begun(patch: Patch) -> None:
    def return_prefetched(self: Session, _: object = None) -> None:
        self.post(headers.Recalled([header.delivery for header, _ in self.prefetched]))

    patch.setattr(Session, "return_prefetched", return_prefetched)


def what_is_recalled_is_lost(patch: Patch) -> None:
    real = Session.return_prefetched

    def return_prefetched(self: Session, wanted: Any = None) -> None:
        real(self, wanted)
        self.outgoing[-1] = headers.Recalled([]), b""

    patch.setattr(Session, "return_prefetched", return_prefetched)


def the_next_is_begun_before_an_answer(patch: Patch) -> None:
    patch.setattr(Session, "has_next", property(lambda self: bool(self.prefetched)))


def what_is_given_back_is_turned_round(patch: Patch) -> None:
    real = Resource.requeue_prefetched

    def requeue_prefetched(self: Resource[Any, Any], message: Any) -> object:
        message.arrival = 1000 - message.arrival
        return real(self, message)

    patch.setattr(Resource, "requeue_prefetched", requeue_prefetched)


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
def test_each_fault_is_found(fault: Callable[[Patch], None], monkeypatch: Patch) -> None:
    make, broken = FAULTS[fault]
    fault(monkeypatch)
    result = compared(make)
    assert result.violation is not None
    assert result.violation.broken == broken
