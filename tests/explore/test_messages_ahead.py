"""Prefetched messages in every order of events. Recalled messages are not started, and every
outcome is also possible without prefetching.
"""

from collections.abc import Callable
from typing import Any

import pytest
from explore import with_ahead as ahead
from explore.scenarios import assert_good
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


def explore_with_prefetch(make: Make) -> tca.Result:
    """Explore with two prefetched messages. Report an outcome that is impossible without
    prefetching as a violation.
    """
    without = assert_good(make(0).scenario, never_stuck())
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
def test_prefetching_adds_no_outcome(make: Make) -> None:
    result = explore_with_prefetch(make)
    assert result.ok, tca.report(result)


@pytest.mark.soak
@pytest.mark.parametrize("make", ahead.UNLIKE)
def test_prefetched_message_is_neither_repeated_nor_lost(make: Make) -> None:
    assert_good(make(2).scenario, never_stuck())


# --- faults ---------------------------------------------------------------------------------------


def no_wait_for_recall(patch: Patch) -> None:
    def recall(self: Prefetcher, resource: Any) -> None:
        if resource.prefetched:
            self._out.recall(resource.prefetching_slot)

    patch.setattr(Prefetcher, "recall", recall)


def recalled_message_started(patch: Patch) -> None:
    def return_prefetched(self: Session, _: object = None) -> None:
        self.post(headers.Recalled([header.delivery for header, _ in self.prefetched]))

    patch.setattr(Session, "return_prefetched", return_prefetched)


def recalled_message_lost(patch: Patch) -> None:
    real = Session.return_prefetched

    def return_prefetched(self: Session, wanted: Any = None) -> None:
        real(self, wanted)
        self.outgoing[-1] = headers.Recalled([]), b""

    patch.setattr(Session, "return_prefetched", return_prefetched)


def next_started_before_answer(patch: Patch) -> None:
    patch.setattr(Session, "may_begin_next", property(lambda self: bool(self.prefetched)))


def recalled_order_reversed(patch: Patch) -> None:
    real = Resource.requeue_prefetched

    def requeue_prefetched(self: Resource[Any, Any], message: Any) -> object:
        message.arrival = 1000 - message.arrival
        return real(self, message)

    patch.setattr(Resource, "requeue_prefetched", requeue_prefetched)


def last_joined_reply_lost(patch: Patch) -> None:
    def together(runs: list[Any], bodies: list[bytes], begun: float) -> tuple[Any, bytes]:
        return headers.Replies(runs[:0:-1] or runs, begun), b"".join(bodies[:0:-1] or bodies)

    patch.setattr(joined_replies, "_join", together)


FAULTS: dict[Callable[[Patch], None], tuple[Make, str]] = {
    no_wait_for_recall: (ahead.locked, "central's own invariants"),
    recalled_message_started: (ahead.overtaken, "what central promises"),
    recalled_message_lost: (ahead.overtaken, "what central promises"),
    next_started_before_answer: (ahead.overtaken, "central's own invariants"),
    last_joined_reply_lost: (ahead.locked_elsewhere, "what central promises"),
    recalled_order_reversed: (ahead.locked_elsewhere, "as without"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_of_prefetching_is_found(fault: Callable[[Patch], None], monkeypatch: Patch) -> None:
    make, broken = FAULTS[fault]
    fault(monkeypatch)
    result = explore_with_prefetch(make)
    assert result.violation is not None
    assert result.violation.broken == broken
