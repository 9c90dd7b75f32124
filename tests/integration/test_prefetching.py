"""Prefetched messages over real sockets. Each message is handled once, in order, and never inside a
lock.
"""

import queue
import threading

import pytest
from integration.commanded import SOON
from module.real_central import RealCentral

from tca_central.order import prefetching
from tca_module import Callback, Client, Inform, LaterReply, Module, Query, Task, connect
from tca_module.link import turns
from tca_wire.journal.facts import Delivered, Granted, Received, RequestRefused, Returned

pytestmark = pytest.mark.slow
COUNT = 1000
NOTE, HEARD = Inform("note", int), Query("heard", reply=list[int])
HOLD, ASK_BACK = Inform("hold"), Query("ask back", reply=int)
DOUBLE, REST = Query("double", int, reply=int), Query("rest", reply=bool)


class Quick:
    """A module whose handlers take no time."""

    def __init__(self, address: str) -> None:
        self.heard: list[int] = []
        self.most_prefetched = 0  #: the most prefetched messages seen
        self.module = Module("quick", address)
        self.module.handles(NOTE, resource="ear")(self.note)
        self.module.handles(HEARD, resource="ear")(lambda _: self.heard)
        self.module.handles(DOUBLE, resource="ear")(self.double)
        self.module.handles(REST, resource="ear")(self.rest)

    def note(self, task: Task, number: int) -> None:
        self.record_prefetched(task)
        self.heard.append(number)

    def double(self, task: Task, number: int) -> int:
        self.record_prefetched(task)
        return 2 * number

    def record_prefetched(self, task: Task) -> None:
        self.most_prefetched = max(self.most_prefetched, len(task._connection().session.prefetched))

    def rest(self, task: Task) -> bool:
        """Lock this handler's own resource. Return whether no prefetched message started inside the
        lock.
        """
        before = len(self.heard)
        with task.lock("ear"):
            return len(self.heard) == before


@pytest.fixture
def quick(address: str, monkeypatch: pytest.MonkeyPatch) -> Quick:
    monkeypatch.setattr(prefetching, "QUICK", 10.0)  # also on a busy machine
    return Quick(address)


def test_prefetched_informs_are_handled_once_in_order(quick: Quick, user: Client) -> None:
    with quick.module.running():
        for number in range(COUNT):
            user.inform(NOTE, number)
        assert user.query(HEARD, timeout=SOON) == list(range(COUNT))
    assert quick.most_prefetched > 1


def test_prefetched_queries_get_their_own_replies(quick: Quick, user: Client) -> None:
    with quick.module.running():
        pending = [user.query_send(DOUBLE, number) for number in range(COUNT)]
        assert [one.receive(timeout=SOON) for one in pending] == [
            2 * number for number in range(COUNT)
        ]
    assert quick.most_prefetched > 1


def test_handler_lock_of_own_resource_delays_prefetched_messages(
    quick: Quick, user: Client
) -> None:
    with quick.module.running():
        for number in range(COUNT):
            user.inform(NOTE, number)
        rests = [user.query_send(REST) for _ in range(5)]
        for number in range(COUNT):
            user.inform(NOTE, number)
        assert all(one.receive(timeout=SOON) for one in rests)
        assert len(user.query(HEARD, timeout=SOON)) == 2 * COUNT


def test_prefetched_messages_are_not_handled_while_locked(
    quick: Quick, user: Client, daemon: RealCentral
) -> None:

    def send() -> None:
        with connect("other", daemon.address) as other:
            for number in range(COUNT):
                other.inform(NOTE, number)

    sending = threading.Thread(target=send)
    with quick.module.running():
        with connect("locker", daemon.address) as locker:
            sending.start()
            for _ in range(20):
                with locker.lock("ear", priority=1):
                    before = len(quick.heard)
                    locker.modules()
                    assert len(quick.heard) == before
            sending.join(SOON)
        assert user.query(HEARD, timeout=SOON) == list(range(COUNT))
    facts = [
        fact for fact in daemon.facts(object) if isinstance(fact, Delivered | Returned | Granted)
    ]
    inside: set[int] = set()
    for fact in facts:
        assert not (isinstance(fact, Granted) and inside), "granted while a message was handled"
        if isinstance(fact, Delivered):
            inside.add(fact.id)
        elif isinstance(fact, Returned):
            inside.discard(fact.id)


def test_prefetched_messages_wait_while_later_reply_is_owed(quick: Quick, user: Client) -> None:
    owed: list[tuple[LaterReply[bool], int]] = []
    later = Query("later", reply=bool)

    @quick.module.handles(later, resource="ear")
    def owe(task: Task) -> LaterReply[bool]:
        owed.append((task.reply_later(), len(quick.heard)))
        return owed[-1][0]

    with quick.module.running():
        for number in range(COUNT):
            user.inform(NOTE, number)
        pending = [user.query_send(later) for _ in range(5)]
        for number in range(COUNT):
            user.inform(NOTE, number)
        for number in range(5):
            while len(owed) <= number:
                user.modules()
            reply, before = owed[number]
            user.modules()
            reply.reply(len(quick.heard) == before)
        assert all(one.receive(timeout=SOON) for one in pending)
        assert len(user.query(HEARD, timeout=SOON)) == 2 * COUNT


def test_hanging_handler_does_not_delay_earlier_replies(
    quick: Quick, user: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(turns, "TURN_SECONDS", SOON)
    hang, may_return = Query("hang", reply=bool), threading.Event()
    quick.module.handles(hang, resource="ear")(lambda _: may_return.wait(SOON))
    with quick.module.running():
        for _ in range(5):
            pending = [user.query_send(DOUBLE, number) for number in range(50)]
            hanging = user.query_send(hang)
            assert [one.receive(timeout=SOON / 2) for one in pending] == [
                2 * number for number in range(50)
            ]
            may_return.set()
            assert hanging.receive(timeout=SOON)
            may_return.clear()


def test_message_sent_by_prefetched_handler_is_accepted_in_order(
    quick: Quick, user: Client, daemon: RealCentral
) -> None:
    echo, forward, echoes = (
        Inform("echo", int),
        Inform("tell", int),
        Query("echoes", reply=list[int]),
    )
    echoed: list[int] = []

    @quick.module.handles(forward, resource="ear")
    def pass_on(task: Task, number: int) -> None:
        if number % 7 == 0:
            task.inform(echo, number)

    quick.module.handles(echo, resource="echo")(lambda _, number: echoed.append(number))
    quick.module.handles(echoes, resource="echo")(lambda _: echoed)
    with quick.module.running():
        for number in range(COUNT):
            user.inform(forward, number)
        user.query(HEARD, timeout=SOON)
        assert user.query(echoes, timeout=SOON) == list(range(0, COUNT, 7))
    forwarded_ids = {fact.id for fact in daemon.facts(Received) if fact.message == forward.name}
    assert {
        fact.origin for fact in daemon.facts(Received) if fact.message == echo.name
    } <= forwarded_ids
    assert daemon.facts(RequestRefused) == []


def test_leaving_module_returns_unstarted_prefetched_messages(
    quick: Quick, user: Client, address: str
) -> None:
    """Prefetched messages that the leaving module has not started go to the next module."""
    with quick.module.running():
        for number in range(COUNT):
            user.inform(NOTE, number)
    after = Quick(address)
    with after.module.running():
        assert user.query(HEARD, timeout=SOON) == after.heard
    assert sorted(quick.heard + after.heard) == list(range(COUNT))


def test_waiting_callback_lets_its_slot_handle_messages(
    quick: Quick, user: Client, daemon: RealCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The test guards against a deadlock. The callback asks another module, which asks the slot of
    the callback.
    """
    monkeypatch.setattr(turns, "TURN_SECONDS", 0.0)  # callbacks come between any two messages
    asker, answers, is_ready = (
        Module("asker", daemon.address),
        queue.Queue[int](),
        threading.Event(),
    )
    asker.handles(ASK_BACK)(lambda task: task.query(DOUBLE, 2, timeout=SOON))

    @quick.module.handles(HOLD, resource="ear")
    def hold(task: Task) -> None:
        is_ready.wait(SOON)
        task.modules()  # prefetched messages arrive before central's answer

    @quick.module.every(0.000001, resource="ear")
    def ask(callback: Callback) -> None:
        if callback._connection().session.prefetched:
            callback.cancel()
            answers.put(callback.query(ASK_BACK, timeout=SOON))

    with quick.module.running(), asker.running():
        for number in range(prefetching.QUICK_RUNS):
            user.inform(NOTE, number)
        user.query(HEARD, timeout=SOON)
        user.inform(HOLD)
        for number in range(3):
            user.inform(NOTE, number)
        user.modules()
        is_ready.set()
        assert answers.get(timeout=SOON) == 4
