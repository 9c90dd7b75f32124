"""The fingerprint of a state: everything that can influence what happens next.

The objects of central and of the scripts are visited from the task tree on, and numbered in the
order of the visits. Ids (see identifiers.py) are numbered, too, so states that differ only in ids
have the same fingerprint. All attributes of an object are included, except those that IGNORED lists
with a reason. If it lists too few attributes, some equal states are explored twice. If it lists too
many, some runs are not explored. Times are relative to now, so each period of a monitor leads to
the same state again.
"""

from collections import deque
from collections.abc import Callable, Iterable
from enum import Enum
from functools import cache
from hashlib import blake2b
from operator import attrgetter, itemgetter
from typing import Any, TypeVar

import msgspec

from tca_central.model.deliveries import Module
from tca_tools.check.records import Hold, MessageRecord
from tca_tools.explore.observed.world import SEEN
from tca_tools.explore.play.actors import Actor
from tca_tools.explore.play.exchange import connection_of
from tca_tools.explore.play.identifiers import Identifier
from tca_tools.explore.play.play import Play
from tca_wire.points import ALL_MOMENTS

T = TypeVar("T")

IGNORED = {
    "Central": {
        "epoch",  # the same for all
        "event_count",  # numbers the journal's entries
        "facts", "failed", "messages", "origin",  # empty between events
        "unconfirmed",  # scripts receive everything at once
        "_outputs", "_output_queues",  # visited where they are filled
        # no search for deadlocks: see Exchange
        "suspects", "blocked", "search_delay", "search_timer", "scan", "may_have_closed",
        "memory",  # only outcomes of tasks that a script can ask for: see _add_outcomes
        "attached", "taps",  # visited where they are attached
        "budget", "answers",  # no exploration reaches these limits
        "watch_of_condition", "watches",  # visited as conditions of monitors, and at their tasks
    },
    "TaskTree": {
        "newest", "tasks",  # ids only identify; all tasks are visited as children
        "never_began",  # only for tasks that a script can name: see _add_outcomes
        "suspended",  # for users to read
        "bytes",  # follows from the tasks
        "crossing_leaders",  # follows from the constraints
    },
    "Holds": {
        "ending",  # empty between events
        "edge_count",  # counted from the constraints
        "ended_followers",  # the time of the next clean-up
    },
    "Registry": {
        "connections",  # visited through their modules
        "lost",  # scripts do not reconnect
        "_names",
        "bytes", "dropped", "next_search",  # counted from the messages; none is forgotten
    },
    "Connection": {
        "id", "session", "number", "last_number", "orphans", "late_answers",  # addresses
        "hung_after", "hang_timers", "was_replaced",  # no handler hangs
        "answers", "answer_bytes",  # scripts repeat no request
        "tasks", "unconfirmed",  # scripts name nothing by its request
        "handling", "waits", "unchecked_waits", "lost_claims",  # visited as deliveries and requests
        "next_began_at", "acts_known_until",  # for users to read: the start and end of runs
    },
    "MessageType": {
        "format", "first_declared_by", "declarers",  # all modules of a scenario declare the same
        "delivered", "failed", "dropped",  # counters, for users to read
        "candidates",  # follow from the handlers
    },
    "ModuleResource": {
        "delivered", "busy", "replaced",  # counters, for users to read
        "quick_runs",  # every handler counts as quick
    },
    "Module": {"process"},
    "AttachedHandler": {"holders"},  # for users to read
    "Delivery": {
        "ticket",  # marks void entries of the queue, which are not visited
        "since",  # for users to read
    },
    "Task": {
        "parent",  # the task is visited as its child
        "size",  # follows from the rest
        "sequence",  # the children again
    },
    "Agenda": {"_clock", "_facts", "wait_count"},
    "Resource": {"_sent_by", "numbers"},  # the queue again; for users to read
    "Claim": {"id", "number", "ticket", "arrival", "timer", "since"},  # follow from the queue
    "Clock": {"now", "_cancelled", "_set_count"},  # timers are relative to now, in their order
    "PendingDelay": {"constraint"},  # only recorded
    "Dispatcher": {
        "_clock", "_facts", "_out", "bytes", "handler_count",
        "_arrivals",  # see add_rank
    },
    "Prefetcher": {"_clock", "_out"},
}  # fmt: skip
"""By class: attributes that cannot influence what happens next."""


OF_LAST_ACTION = {"is_over", "is_new", "is_retried", "has_fired"}
"""The attributes of a message that describe the last action only."""


class Detail(msgspec.Struct, frozen=True):
    """Differences between states after which the same happens. They count only if needed."""

    time: bool = False
    """The duration of the run so far. Needed if a property reads the time."""
    names: bool = False
    """The slot of each message, and which message is older. Needed to follow waiters from state to
    state.
    """


def fingerprint_of(
    play: Play, memories: Iterable[int], detail: Detail
) -> tuple[bytes, tuple[int, ...]]:
    """Return the fingerprint of a state and its messages.

    Args:
        play: the state.
        memories: the memories of the properties.
        detail: further differences to include.

    Returns:
        A digest that is unique among different states; and the messages under way, in an order
        that all equal states have in common.
    """
    walk = _Walk(play.queue_groups, play.now)
    central = play.central
    # Sorted by name, so that the order between modules does not show.
    for name, siblings in _by_name(central.tree.top_of_module):
        walk.add(name)
        walk.add(list(siblings.values()))
    walk.add(central)
    walk.finish()
    _add_modules(walk, play, detail)
    _add_outcomes(walk, play)
    order = _add_world(walk, play, detail)
    walk.add([*memories, round(play.now, _DIGITS) if detail.time else None])
    return walk.digest(), order


def _by_name(things: dict[Module | None, T]) -> list[tuple[str, T]]:
    """Return each module's name and its thing, sorted by name; of equal names the older first."""
    return sorted(
        ((module.name if module else "", thing) for module, thing in things.items()),
        key=itemgetter(0),
    )


class _Walk:
    """A walk over objects: their numbers, and the values written for the digest."""

    def __init__(self, queue_groups: dict[str, int], now: float) -> None:
        self._queue_groups = queue_groups
        self._now = now
        self._out: list[Any] = []
        self._numbers: dict[int, int] = {}  #: of objects, by id()
        self._names: dict[tuple[type, int], int] = {}  #: numbers of identifiers
        self._unseen: deque[object] = deque()
        self._unordered: list[Iterable[Any]] = []  #: containers whose order does not matter
        #: By group of messages: (arrival, place in _out).
        self._ranks: dict[int, list[tuple[int, int]]] = {}

    def add(self, value: Any) -> None:
        """Write a value; for an object its number, and its attributes when its turn comes."""
        kind: type = type(value)
        if kind in _PLAIN:
            self._out.append(value)
        else:
            _writer_of(kind)(self, value)

    def write(self, *plain: Any) -> None:
        """Write plain values."""
        self._out += plain

    def number_of_name(self, name: int) -> int:
        """Return the number of an identifier."""
        return self._names.setdefault((type(name), int(name)), len(self._names))

    def knows_name(self, name: int) -> bool:
        """Whether an identifier has a number already."""
        return (type(name), int(name)) in self._names

    def number_of(self, thing: object) -> int:
        """Return the number of an object. A new object is visited when its turn comes."""
        number = self._numbers.get(id(thing))
        if number is None:
            self._numbers[id(thing)] = number = len(self._numbers)
            self._unseen.append(thing)
        return number

    def finish(self) -> None:
        """Visit all objects that were reached.

        Containers without order come last. Their members that have a number by then are written in
        the order of the numbers, so the order of the container does not matter.
        """
        while self._unseen or self._unordered:
            while self._unseen:
                self._visit(self._unseen.popleft())
            if self._unordered:
                things = self._unordered.pop(0)
                known = sorted(
                    self._numbers[id(thing)] for thing in things if id(thing) in self._numbers
                )
                self._out += _KNOWN, len(known), *known
                for thing in things:
                    self.number_of(thing)

    def _visit(self, thing: Any) -> None:
        kind: type = type(thing)
        out, add = self._out, self.add
        out.append(kind.__name__)
        fetch, writes = _attributes(kind, tuple(getattr(thing, "__dict__", ())))
        for value, write in zip(fetch(thing), writes, strict=True):
            if write is not None:
                write(self, thing, value)
            elif (value_type := type(value)) in _PLAIN:  # the commonest case, without a call
                out.append(value)
            elif value_type in _EMPTY and not value:
                out += _EMPTY[value_type]
            else:
                add(value)

    # --- values -----------------------------------------------------------------------------------

    def add_struct(self, value: msgspec.Struct) -> None:
        self._out.append(type(value).__name__)
        self.add(msgspec.structs.astuple(value))

    def add_list(self, values: Any) -> None:
        self._out += _LIST, len(values)
        for value in values:
            if type(value) in _PLAIN:
                self._out.append(value)
            else:
                self.add(value)

    def add_dict(self, values: dict[Any, Any]) -> None:
        self._out += _DICT, len(values)
        for key, value in values.items():
            self.add(key)
            self.add(value)

    # --- attributes with a form of their own ------------------------------------------------------

    def add_rank(self, delivery: Any, arrival: int) -> None:
        """Add the rank of an arrival among the messages that may wait in the same queue."""
        group = self._queue_groups.get(delivery.message.name, -1)
        self._ranks.setdefault(group, []).append((arrival, len(self._out)))
        self._out.append(arrival > 0)

    def add_unordered(self, _: object, values: dict[Any, Any]) -> None:
        self._unordered.append(list(values.values()))

    def add_unordered_keys(self, _: object, values: dict[Any, Any]) -> None:
        self._unordered.append(list(values))

    def add_by_name(self, _: object, values: dict[str, Any]) -> None:
        for name in sorted(values):
            self.add(name)
            self.add(values[name])

    def add_children(self, task: Any, children: dict[int, Any] | None) -> None:
        if task.id:
            self.add(list((children or {}).values()))
        else:  # the order of all tasks under the root influences nothing
            self.add_unordered(task, children or {})

    # --- time -------------------------------------------------------------------------------------

    def add_time(self, _: object, time: float | None) -> None:
        self._out.append(None if time is None else round(time - self._now, _DIGITS))

    def add_due(self, clock: Any, _: object) -> None:
        """Add the timers, in the order in which they are due."""
        for _time, _number, timer in sorted(clock._queue, key=itemgetter(0, 1)):  # noqa: SLF001
            if not timer.is_cancelled:
                self.add(timer)
        self._out.append(_END)

    def add_phase(self, watch: Any, since: float) -> None:
        """Add the part of a monitor's period that is over."""
        period = watch.options.period
        passed = 0.0
        if watch.watching_since is not None and period:
            passed = round((self._now - since) % period, _DIGITS)
        self.add(0.0 if passed == round(period, _DIGITS) else passed)

    def add_attachment(self, _: object, attached: Any) -> None:
        """Add an attachment, and how many older ones its task or message has.

        The attachment itself may have been removed from there.
        """
        self.add(attached)
        place = attached.place
        self._out.append(sum(other.id < attached.id for other in place.attached))

    def digest(self) -> bytes:
        """Return a digest of all that was written, with the ranks of arrivals filled in."""
        for ranks in self._ranks.values():
            for rank, (arrival, place) in enumerate(sorted(ranks), start=1):
                self._out[place] = rank if arrival else 0
        try:
            written = msgspec.msgpack.encode(self._out)
        except OverflowError:  # MessagePack has no longer integers
            written = msgspec.msgpack.encode([*map(_narrow, self._out)])
        return blake2b(written, digest_size=16).digest()


def _narrow(value: Any) -> Any:
    """Return an integer that is too wide for MessagePack as text, anything else unchanged."""
    return hex(value) if type(value) is int and value.bit_length() > _WIDEST else value


_LIST, _DICT, _NAME, _THING, _KNOWN, _END = (msgspec.msgpack.Ext(code, b"") for code in range(6))
"""Marks that differ from every value."""

_PLAIN = frozenset((str, bytes, bool, int, float, type(None)))
_EMPTY: dict[type, tuple[Any, int]] = {
    list: (_LIST, 0),
    tuple: (_LIST, 0),
    deque: (_LIST, 0),
    dict: (_DICT, 0),
}
_CONTAINERS = (list, tuple, dict, set, frozenset, deque)
_WIDEST = 63  # bits of an integer
_DIGITS = 6  # decimals of seconds: a smaller difference is an error of rounding
_WRITERS: tuple[tuple[tuple[type, ...], Callable[[_Walk, Any], None]], ...] = (
    ((Enum,), lambda walk, value: walk.add(value.value)),
    ((Identifier,), lambda walk, name: walk.write(_NAME, walk.number_of_name(name))),
    ((int,), lambda walk, value: walk.write(int(value))),
    ((msgspec.Struct,), _Walk.add_struct),
    ((list, tuple, deque), _Walk.add_list),
    ((dict,), _Walk.add_dict),
)
"""By class: how a value is written. The first row that fits counts. Any other object gets a number.
"""


def _add_thing(walk: _Walk, value: object) -> None:
    walk.write(_THING, walk.number_of(value))


@cache
def _writer_of(kind: type) -> Callable[[_Walk, Any], None]:
    """Return the function that writes values of a class that is not plain."""
    return next((write for classes, write in _WRITERS if issubclass(kind, classes)), _add_thing)


Write = Callable[[_Walk, Any, Any], None]

SPECIAL: dict[tuple[str, str], Write] = {
    ("TaskTree", "last_of_module"): lambda walk, _, tasks: (
        walk.add(  # flags do not refer to ended tasks
            [(name, task) for name, task in _by_name(tasks) if task.reached != ALL_MOMENTS]
        )
    ),
    ("TaskTree", "top_of_module"): lambda walk, _, siblings: walk.add(_by_name(siblings)),
    ("Task", "children"): _Walk.add_children,
    ("Delivery", "arrival"): _Walk.add_rank,
    ("Tapping", "fired"): lambda walk, _, taps: walk.add(sorted(taps.items())),
    ("Tapping", "listeners"): lambda walk, _, tasks: walk.add(
        [one for one in tasks if one.reached != ALL_MOMENTS]
    ),
    ("FailureContext", "attached"): _Walk.add_attachment,
    ("PendingKill", "verdict"): lambda walk, _, verdict: walk.add([verdict.why, verdict.by]),
    ("Watch", "timers"): lambda walk, _, timers: walk.add(
        [timer for timer in timers.values() if not timer.is_cancelled]
    ),
    ("Watch", "watching_since"): lambda walk, _, began: walk.add(began is None),
    ("Watch", "periods_from"): _Walk.add_phase,
    ("Watch", "times_met"): lambda walk, watch, count: walk.write(count % watch.options.fire_every),
    ("Watch", "actions_sent"): lambda walk, watch, fires: walk.write(
        fires if watch.options.maximum else 0
    ),
    ("Timer", "time"): _Walk.add_time,
    ("Clock", "_queue"): _Walk.add_due,
    ("Registry", "modules"): _Walk.add_unordered,
    ("Registry", "messages"): _Walk.add_by_name,
    ("Module", "connections"): _Walk.add_unordered,
    ("Resource", "slots"): _Walk.add_unordered_keys,
    ("Resource", "_queue"): lambda walk, resource, _: walk.add(resource.in_line()),
    # The order of nested deliveries is that of the scripts on their line.
    ("Dispatcher", "running"): _Walk.add_unordered,
    ("Lending", "postponed"): _Walk.add_unordered,
    ("Resource", "lendable"): _Walk.add_unordered,
}
"""By class and attribute: how to write an attribute of which only a part matters, or not the order.
"""


@cache
def _attributes(
    kind: type, names: tuple[str, ...]
) -> tuple[Callable[[Any], Iterable[Any]], tuple[Write | None, ...]]:
    """Return a getter of the attributes of a class, and the special writer of each.

    The attributes are those in slots and *names*, without IGNORED.
    """
    assert not issubclass(kind, _CONTAINERS), f"the items of {kind.__name__} would not be visited"
    slots = [name for parent in reversed(kind.__mro__) for name in getattr(parent, "__slots__", ())]
    kinds = [parent.__name__ for parent in kind.__mro__]
    wanted = [
        name
        for name in (*slots, *names)
        if not any(name in IGNORED.get(kind, ()) for kind in kinds)
    ]
    special = {name: write for (owner, name), write in SPECIAL.items() if owner in kinds}
    fetch = (
        attrgetter(*wanted)
        if len(wanted) > 1
        else lambda thing: [getattr(thing, name) for name in wanted]
    )
    return fetch, tuple(special.get(name) for name in wanted)


# --- the modules' side, and the world of properties -----------------------------------------------


def _add_modules(walk: _Walk, play: Play, detail: Detail) -> None:
    for name in sorted(play.runs):
        run = play.runs[name]
        walk.add([name, run.steps_joined, len(run.first_programs), run.is_alive, run.is_leaving])
        connections = play.central.registry.connections
        lines = [
            (walk.number_of(connections[connection_of(line.name)]), line) for line in run.lines
        ]
        for number, line in sorted(lines, key=itemgetter(0)):
            is_named = detail.names or play.scenario.has_prefetch
            walk.add([number, line.name if is_named else len(line.actors)])
            for actor in line.actors:
                _add_actor(walk, actor, has_begun=actor not in line.delivered)
            if line.inbox is not None:
                walk.add(line.inbox.state)
    chances = play.losses, play.kills, play.suspensions, play.suspended
    walk.add([value for each in chances for value in each.values()])
    walk.add(sorted(play.digests.items()))


def _add_actor(walk: _Walk, actor: Actor, *, has_begun: bool) -> None:
    walk.add(
        [
            has_begun,
            actor.program.name,
            actor.script_run.number,
            actor.delivery,
            actor.number,
            actor.step is None,
            actor.is_killed,
            actor.was_ending,
            actor.knows_of_kill,
            actor.is_ending,
            actor.knows_of_module_end,
            actor.suspended[-1],
            len(set(actor.suspended)),
            *actor.known_ids,
            list(actor.reply_uses),
        ]
    )
    for place, request in actor.requests.items():
        walk.add([place, request.number, request.is_over, list(request.unread)])
    walk.add_time(actor, actor.times_out_at)


def _add_outcomes(walk: _Walk, play: Play) -> None:
    """Add the outcomes of ended tasks that a script can still ask for or constrain."""
    never_began = play.central.tree.never_began
    known = {
        walk.number_of_name(key): ended
        for key, ended in play.central.memory.outcomes.items()
        if walk.knows_name(key)
    }
    for number in sorted(known):
        walk.add([number, *known[number]])
    unbegun = {
        walk.number_of_name(key): starts
        for key, starts in never_began.items()
        if walk.knows_name(key)
    }
    walk.add([*sorted(unbegun.items())])


def _add_world(walk: _Walk, play: Play, detail: Detail) -> tuple[int, ...]:
    """Add the state that properties see; return the messages in the order of their numbers."""
    known = {walk.number_of_name(item.id): item for item in play.world.messages if not item.is_over}
    if detail.names:
        walk.add(list(known))  # oldest first
    for number in sorted(known):
        _add_message(walk, known[number], play.now)
    held_by = play.world.held_by
    walk.add([(*key, held_by[key].sender, held_by[key].is_reserved) for key in sorted(held_by)])
    walk.add(sorted(play.world.modules))
    return tuple(known[number].id for number in sorted(known))


def _add_message(walk: _Walk, item: MessageRecord, now: float) -> None:
    """Add all that properties see of a message, and all that the rules need later."""
    walk.add(
        [item.id, item.parent_id, item.about, item.sent_by, item.never_began, item.has_resolved]
    )
    walk.add(
        [item.recovering, *(getattr(item, name) for name in SEEN if name not in OF_LAST_ACTION)]
    )
    walk.add([_without_times(hold, now) for hold in item.holds if not hold.is_over])


def _without_times(hold: Hold, now: float) -> list[Any]:
    """Return the values of a constraint, with the rest of its delay if that has started."""
    left = None if hold.due is None else round(hold.due - now, _DIGITS)
    return [hold.moment, hold.constraint.before, hold.constraint.delay if left is None else left]
