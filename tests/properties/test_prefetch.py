"""Slots with prefetched messages. Each run could also have happened without prefetching."""

from collections.abc import Iterator
from typing import Any

import pytest
from central.test_oracle import NO_SMALLER_SEED, JudgedLife, JudgedPlayer
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Operations, operations
from sampling import lives

from dev.invariants import check_invariants
from tca_central.core import Central
from tca_central.events import Effect, RequestReceived, Tick
from tca_central.model.deliveries import Connection, Delivery
from tca_central.order import prefetching
from tca_wire.packets import headers
from tca_wire.packets.parts import EndedRun
from tca_wire.points import TaskId
from tca_wire.vocabulary import Condition


@pytest.fixture(autouse=True, scope="module")
def every_handler_is_quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prefetching, "QUICK", float("inf"))
        patch.setattr(prefetching, "QUICK_RUNS", 0)
        yield


PREFETCHABLE = ("note", "pose", "all", "where")
LISTENING = (Condition.WHEN_SENT, Condition.AFTER_HANDLED, Condition.AFTER_REPLIED)
HANDLERS_CHANGE = headers.Hello | headers.Register | headers.Unregister | headers.Bye


class DeliveryAtStart:
    """An output that sends a delivery when the slot starts it, as if nothing were prefetched."""

    def __init__(self, central: Central) -> None:
        self.central = central
        self.recalled: list[Connection] = []
        self.most = self.recalls = self.tapped = 0

    def deliver(self, delivery: Delivery, slot: Connection, *, is_prefetched: bool) -> None:
        del is_prefetched
        self.central.deliver(delivery, slot, is_prefetched=False)

    def send_prefetched(self, delivery: Delivery, slot: Connection) -> None:
        assert slot.resource is not None
        self.tapped += bool(delivery.message.taps)
        self.most = max(self.most, len(slot.resource.prefetched))

    def recall(self, slot: Connection) -> None:
        self.recalls += 1
        self.recalled.append(slot)


class PrefetchPlayer(JudgedPlayer):
    """A player whose slots take prefetched messages, and return recalled messages at once. The
    oracle knows nothing of prefetching, and must agree with central.
    """

    prefetch = 3

    def __init__(self) -> None:
        super().__init__()
        dispatcher = self.central.dispatcher
        self.out = dispatcher._out = dispatcher.prefetcher._out = DeliveryAtStart(self.central)
        self.joined = 0

    def _judged(self, event: Any) -> list[Effect]:
        effects = []
        if isinstance(event, RequestReceived) and isinstance(event.header, headers.Reply):
            event = self._joined_replies(event, event.header)
        for slot in list(self.central.registry.connections.values()):
            if self._must_return_prefetched(event, slot):
                effects += self._return_prefetched(slot, event.time)
        effects += self.central.handle(event)
        while self.out.recalled:
            effects += self._return_prefetched(self.out.recalled.pop(), event.time)
        check_invariants(self.central)
        self.note(effects)
        self.oracle.judge(event, effects)
        return effects

    def _joined_replies(self, event: RequestReceived, header: headers.Reply) -> RequestReceived:
        """Let the slot reply to some prefetched messages in the same packet."""
        slot = self.central.registry.connections[event.connection]
        others = (
            list(slot.resource.prefetched)[: round(event.time) % 3]
            if slot.resource is not None
            else []
        )
        if not others or slot.resource.is_recalling or len(slot.handling) > 1:  # type: ignore[union-attr]
            return event
        self.joined += len(others)
        numbers = [header.delivery, *(one.handling_id for one in others)]
        runs = [
            EndedRun(one, 0.1 * ago, 0.1, len(event.body))
            for ago, one in enumerate(reversed(numbers))
        ]
        return RequestReceived(
            event.time, event.connection, headers.Replies(runs[::-1]), event.body * len(runs)
        )

    @staticmethod
    def _must_return_prefetched(event: Any, slot: Connection) -> bool:
        """Whether a slot must return its prefetched messages before an event. The event may be a
        claim by the slot, a change of handlers, or a lost connection.
        """
        if slot.resource is None or not slot.resource.prefetched or isinstance(event, Tick):
            return False
        is_own = isinstance(event, RequestReceived) and event.connection == slot.id
        if isinstance(event, RequestReceived) and not isinstance(event.header, HANDLERS_CHANGE):
            return is_own and isinstance(event.header, headers.Lock)
        return True

    def _return_prefetched(self, slot: Connection, time: float) -> list[Effect]:
        unbegun = (
            [one.handling_id for one in slot.resource.prefetched]
            if slot.resource is not None
            else []
        )
        event = RequestReceived(time, slot.id, headers.Recalled(unbegun))
        effects: list[Effect] = []
        self.central._receive(event, effects)  # due timers have an event of their own
        return effects


class PrefetchLife(JudgedLife):
    """A life in which most sent messages may be prefetched, and have few handlers."""

    player_class = PrefetchPlayer

    def join(self, module: str) -> None:
        self.generation += 1
        pool = "all" if self.generation % 5 == 0 else ""
        self.player.module(f"{module}{self.generation}", *self.modules[module], pool=pool)

    def sent_name(self, b: int) -> str:
        return super().sent_name(b) if b % 4 == 0 else PREFETCHABLE[b // 4 % len(PREFETCHABLE)]

    def tap_(self, a: int, b: int, c: int, d: int) -> None:
        """Add a wiretap. Half of the taps have conditions that allow prefetching: sending, or the
        end of handling.
        """
        if a % 2:
            super().tap_(a // 2, b, c, d)
            return
        condition, listener = (
            LISTENING[a // 2 % len(LISTENING)],
            ("note", "pose", "lift", "watch")[c % 4],
        )
        options = self.watch_options(d, b, c) if listener == "watch" else None
        self.request(
            headers.Tap,
            condition,
            listener,
            PREFETCHABLE[b % len(PREFETCHABLE)],
            TaskId(0),
            options,
        )

    def join_(self, a: int, *others: int) -> None:
        if len(self.connections()) < 10:
            super().join_(a, *others)


@given(operations)
@settings(max_examples=12)
def test_prefetching_central_agrees_with_oracle_in_short_life(taken: Operations) -> None:
    PrefetchLife().live(taken)


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(2, soak=200), phases=NO_SMALLER_SEED)
def test_prefetching_central_agrees_with_oracle_in_long_life(seed: int) -> None:
    PrefetchLife().go_on(seed, lives(400, soak=2000))


def test_prefetch_lives_cover_recalls_taps_and_joined_replies() -> None:
    most = recalls = joined = tapped = 0
    for seed in range(30):
        if most > 1 and recalls and joined and tapped:
            return
        life = PrefetchLife()
        life.go_on(seed, 400)
        assert isinstance(life.player, PrefetchPlayer)
        most, recalls = max(most, life.player.out.most), recalls + life.player.out.recalls
        joined, tapped = joined + life.player.joined, tapped + life.player.out.tapped
    counts = f"at most {most} were ahead, {tapped} of them tapped, {recalls} recalls, {joined} replies joined"
    pytest.fail(f"{counts}: these lives do not cover prefetching")
