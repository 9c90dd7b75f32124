"""The fingerprint of a state: everything that can influence what happens next.

The objects of central and of the scripts are walked from the task tree on and numbered as they are
met, ids (see identifiers.py) too, so two states are equal if they differ in ids only. *Everything*
that an object holds is taken in, except what IGNORED lists with its reason. Taking in too much
costs states that could have been one; leaving out too much would leave runs unexplored. Times are
relative to now: a period comes to the same state again.
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
        "events",  # numbers the journal's entries
        "facts", "failed", "messages", "origin",  # empty between events
        "untold",  # scripts are told at once
        "_outputs", "_output_queues",  # met where they are filled
        "suspects", "blocked", "look_after", "next_look", "scan", "may_have_closed",  # nobody looks: see Play
        "memory",  # outcomes only of tasks that a script can ask for: see _add_outcomes
        "attached", "taps",  # met where they are attached
        "budget", "answers",  # no exploration is so big
        "watch_of_condition", "watches",  # met as the conditions of monitors, and at their tasks
    },
    "TaskTree": {
        "newest", "tasks",  # ids are only names; all tasks are met as children
        "never_began",  # only of tasks that a script can name: see _add_outcomes
        "suspended",  # for people
        "bytes",  # follows from the tasks
        "across",  # says no more than the constraints
    },
    "Holds": {
        "ending",  # empty between events
        "edges",  # counted from the constraints
        "ended_followers",  # when to look through them
    },
    "Registry": {
        "connections",  # met through their modules
        "lost",  # scripts do not reconnect
        "_names",
        "bytes", "dropped", "next_search",  # counted from the messages; none is forgotten
    },
    "Connection": {
        "id", "session", "number", "last_number", "orphans", "late",  # addresses
        "hung_after", "doubts", "was_replaced",  # no handler hangs
        "answers", "answer_bytes",  # scripts repeat nothing
        "tasks", "untold",  # nor name they anything by its request
        "handling", "waits", "pauses", "lost_claims",  # met as what is handled and asked
        "begins", "known_until",  # for people: when runs began and ended
    },
    "MessageType": {
        "format", "first_declared_by", "declarers",  # all modules of a scenario declare the same
        "delivered", "failed", "dropped",  # only counted, for people
        "candidates",  # follow from the handlers
    },
    "ModuleResource": {"delivered", "busy", "quick_runs", "replaced"},  # likewise; every handler counts as quick
    "Module": {"process"},
    "AttachedHandler": {"holders"},  # for people
    "Delivery": {
        "ticket",  # marks void entries of the queue, which are left out
        "since",  # for people
    },
    "Task": {"parent", "size", "sequence"},  # met as a child of it; what follows; its children once more
    "Agenda": {"_facts", "waits"},
    "Resource": {"_sent_by", "numbers"},  # the same queue in other words; for people
    "Claim": {"id", "number", "ticket", "arrival", "timer", "since"},  # its place in the queue shows
    "Clock": {"now", "_asked", "_cancelled"},  # what is due is taken relative to now, in its order
    "PendingDelay": {"constraint"},  # as it is recorded
    "Dispatcher": {"_clock", "_facts", "_out", "_arrivals", "bytes", "handlers"},  # of arrivals see add_rank
    "MessagesAhead": {"_clock", "_out"},
}  # fmt: skip
"""By class: attributes that cannot influence what happens next."""


OF_LAST_ACTION = {"is_over", "is_new", "is_retried", "has_fired"}
"""What properties see of a message for one action only."""


class Detail(msgspec.Struct, frozen=True):
    """Details that tell states apart though the same happens next: only where somebody needs
    them.
    """

    time: bool = False
    """How long the run has lasted: properties look at it."""
    names: bool = False
    """Which slot has what, and which message is older: who is who can be followed from state to
    state.
    """


def recognised(
    play: Play, memories: Iterable[int], detail: Detail
) -> tuple[bytes, tuple[int, ...]]:
    """The fingerprint, a digest that differs from those of other states; and the messages under way
    in an order that is that of all equal states. *memories* are what properties remember.
    """
    walk = _Walk(play.rivals, play.now)
    central = play.central
    for name, siblings in _by_name(
        central.tree.top_of_module
    ):  # so that the order between modules does not show
        walk.add(name)
        walk.add(list(siblings.values()))
    walk.add(central)
    walk.finish()
    _add_modules(walk, play, detail)
    _add_outcomes(walk, play)
    order = _add_seen(walk, play, detail)
    walk.add([*memories, round(play.now, _DIGITS) if detail.time else None])
    return walk.digest(), order


def _by_name(things: dict[Module | None, T]) -> list[tuple[str, T]]:
    """What modules have, by their names; of namesakes the older first."""
    return sorted(
        ((one.name if one else "", thing) for one, thing in things.items()), key=itemgetter(0)
    )


class _Walk:
    """The objects met so far, and what was written down about them."""

    def __init__(self, rivals: dict[str, int], now: float) -> None:
        self._rivals = rivals
        self._now = now
        self._out: list[Any] = []
        self._numbers: dict[int, int] = {}  #: of objects, by id()
        self._names: dict[tuple[type, int], int] = {}  #: of marks
        self._unseen: deque[object] = deque()
        self._later: list[Iterable[Any]] = []  #: containers without order
        self._ranks: dict[
            int, list[tuple[int, int]]
        ] = {}  #: by group of rivals: (arrival, place in _out)

    def add(self, value: Any) -> None:
        """Write down a value; an object by its number, and what it holds when its turn comes."""
        kind: type = type(value)
        if kind in _PLAIN:
            self._out.append(value)
        else:
            _way_of(kind)(self, value)

    def write(self, *plain: Any) -> None:
        """Write down values as they are."""
        self._out += plain

    def number_of_name(self, name: int) -> int:
        return self._names.setdefault((type(name), int(name)), len(self._names))

    def knows_name(self, name: int) -> bool:
        return (type(name), int(name)) in self._names

    def number_of(self, thing: object) -> int:
        """The number of an object; a new one is looked at when its turn comes."""
        number = self._numbers.get(id(thing))
        if number is None:
            self._numbers[id(thing)] = number = len(self._numbers)
            self._unseen.append(thing)
        return number

    def finish(self) -> None:
        """Look at all objects that were met."""
        while self._unseen or self._later:
            while self._unseen:
                self._look_at(self._unseen.popleft())
            if self._later:
                things = self._later.pop(0)
                known = sorted(
                    self._numbers[id(thing)] for thing in things if id(thing) in self._numbers
                )
                self._out += _KNOWN, len(known), *known
                for thing in things:
                    self.number_of(thing)

    def _look_at(self, thing: Any) -> None:
        kind: type = type(thing)
        out, add = self._out, self.add
        out.append(kind.__name__)
        fetch, writes = _attributes(kind, tuple(getattr(thing, "__dict__", ())))
        for value, write in zip(fetch(thing), writes, strict=True):
            if write is not None:
                write(self, thing, value)
            elif (of := type(value)) in _PLAIN:  # most are: what add would do, without the call
                out.append(value)
            elif of in _EMPTY and not value:
                out += _EMPTY[of]
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

    # --- attributes that are not what they seem ---------------------------------------------------

    def add_rank(self, delivery: Any, arrival: int) -> None:
        """Only the order of arrivals matters, and only among those that may wait in the same
        queue.
        """
        group = self._rivals.get(delivery.message.name, -1)
        self._ranks.setdefault(group, []).append((arrival, len(self._out)))
        self._out.append(arrival > 0)

    def add_unordered(self, _: object, values: dict[Any, Any]) -> None:
        self._later.append(list(values.values()))

    def add_unordered_keys(self, _: object, values: dict[Any, Any]) -> None:
        self._later.append(list(values))

    def add_by_name(self, _: object, values: dict[str, Any]) -> None:
        for name in sorted(values):
            self.add(name)
            self.add(values[name])

    def add_children(self, task: Any, children: dict[int, Any] | None) -> None:
        if task.id:
            self.add(list((children or {}).values()))
        else:  # nothing looks at all tasks under the root in their order
            self.add_unordered(task, children or {})

    # --- time -------------------------------------------------------------------------------------

    def add_time(self, _: object, time: float | None) -> None:
        self._out.append(None if time is None else round(time - self._now, _DIGITS))

    def add_due(self, clock: Any, _: object) -> None:
        """Add the timers, in the order in which they are due."""
        for _time, _asked, timer in sorted(clock._queue, key=itemgetter(0, 1)):  # noqa: SLF001
            if not timer.is_cancelled:
                self.add(timer)
        self._out.append(_END)

    def add_phase(self, watch: Any, since: float) -> None:
        """Add how much of a monitor's period is over."""
        period = watch.options.period
        passed = (
            round((self._now - since) % period, _DIGITS)
            if watch.began is not None and period
            else 0.0
        )
        self.add(0.0 if passed == round(period, _DIGITS) else passed)

    def add_attachment(self, _: object, attached: Any) -> None:
        """An attachment that may have been removed since: its place among the others is by its
        age.
        """
        self.add(attached)
        place = attached.place
        self._out.append(sum(other.id < attached.id for other in place.attached))

    def digest(self) -> bytes:
        for ranks in self._ranks.values():
            for rank, (arrival, place) in enumerate(sorted(ranks), start=1):
                self._out[place] = rank if arrival else 0
        try:
            written = msgspec.msgpack.encode(self._out)
        except OverflowError:  # MessagePack has no longer integers
            written = msgspec.msgpack.encode(
                [
                    hex(one) if type(one) is int and one.bit_length() > _WIDEST else one
                    for one in self._out
                ]
            )
        return blake2b(written, digest_size=16).digest()


_LIST, _DICT, _NAME, _THING, _KNOWN, _END = (msgspec.msgpack.Ext(code, b"") for code in range(6))
"""Marks that no value looks like."""

_PLAIN = frozenset((str, bytes, bool, int, float, type(None)))
_EMPTY: dict[type, tuple[Any, int]] = {
    list: (_LIST, 0),
    tuple: (_LIST, 0),
    deque: (_LIST, 0),
    dict: (_DICT, 0),
}
_CONTAINERS = (list, tuple, dict, set, frozenset, deque)
_WIDEST = 63  # bits of an integer
_DIGITS = 6  # of seconds: times that differ by less are the same but for rounding
_WAYS: tuple[tuple[tuple[type, ...], Callable[[_Walk, Any], None]], ...] = (
    ((Enum,), lambda walk, value: walk.add(value.value)),
    ((Identifier,), lambda walk, name: walk.write(_NAME, walk.number_of_name(name))),
    ((int,), lambda walk, value: walk.write(int(value))),
    ((msgspec.Struct,), _Walk.add_struct),
    ((list, tuple, deque), _Walk.add_list),
    ((dict,), _Walk.add_dict),
)
"""How a value of one of those classes is written down: the first that fits. All else is a thing
with a number.
"""


def _add_thing(walk: _Walk, value: object) -> None:
    walk.write(_THING, walk.number_of(value))


@cache
def _way_of(kind: type) -> Callable[[_Walk, Any], None]:
    """How values of a class that is not plain are written down."""
    return next((write for classes, write in _WAYS if issubclass(kind, classes)), _add_thing)


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
    ("Watch", "began"): lambda walk, _, began: walk.add(began is None),
    ("Watch", "since"): _Walk.add_phase,
    ("Watch", "count"): lambda walk, watch, count: walk.write(count % watch.options.fire_every),
    ("Watch", "fires"): lambda walk, watch, fires: walk.write(
        fires if watch.options.maximum else 0
    ),
    ("Timer", "time"): _Walk.add_time,
    ("Clock", "_queue"): _Walk.add_due,
    ("Registry", "modules"): _Walk.add_unordered,
    ("Registry", "messages"): _Walk.add_by_name,
    ("Module", "connections"): _Walk.add_unordered,
    ("Resource", "slots"): _Walk.add_unordered_keys,
    ("Resource", "_queue"): lambda walk, resource, _: walk.add(resource.in_line()),
    (
        "Dispatcher",
        "running",
    ): _Walk.add_unordered,  # the order of nested ones is that of the scripts on their line
}
"""By class and attribute: of what only a part, or not the order, can influence what happens
next.
"""


@cache
def _attributes(
    kind: type, names: tuple[str, ...]
) -> tuple[Callable[[Any], Iterable[Any]], tuple[Write | None, ...]]:
    """The getter of the attributes to look at, in slots and of these *names*, and the way each is
    written down.
    """
    assert not issubclass(kind, _CONTAINERS), (
        f"of a {kind.__name__} nothing but its class would be taken in"
    )
    slots = [name for parent in reversed(kind.__mro__) for name in getattr(parent, "__slots__", ())]
    kinds = [parent.__name__ for parent in kind.__mro__]
    wanted = [
        name for name in (*slots, *names) if not any(name in IGNORED.get(one, ()) for one in kinds)
    ]
    special = {name: write for (one, name), write in SPECIAL.items() if one in kinds}
    fetch = (
        attrgetter(*wanted)
        if len(wanted) > 1
        else lambda thing: [getattr(thing, name) for name in wanted]
    )
    return fetch, tuple(special.get(name) for name in wanted)


# --- the modules' side, and what properties see ---------------------------------------------------


def _add_modules(walk: _Walk, play: Play, detail: Detail) -> None:
    for name in sorted(play.runs):
        run = play.runs[name]
        walk.add([name, run.steps_joined, len(run.first), run.is_alive, run.is_leaving])
        connections = play.central.registry.connections
        lines = [
            (walk.number_of(connections[connection_of(line.name)]), line) for line in run.lines
        ]
        for number, line in sorted(lines, key=itemgetter(0)):
            walk.add(
                [
                    number,
                    line.name
                    if detail.names or play.scenario.has_messages_ahead
                    else len(line.actors),
                ]
            )
            for actor in line.actors:
                _add_actor(walk, actor, has_begun=actor in line.stack)
            if line.inbox is not None:
                walk.add(line.inbox.state)
    walk.add(
        [
            *play.losses.values(),
            *play.kills.values(),
            *play.suspensions.values(),
            *play.suspended.values(),
        ]
    )
    walk.add(sorted(play.lived.items()))


def _add_actor(walk: _Walk, actor: Actor, *, has_begun: bool) -> None:
    walk.add(
        [
            has_begun,
            actor.program.name,
            actor.life.number,
            actor.delivery,
            actor.number,
            actor.step is None,
            actor.is_told,
            actor.was_told,
            actor.knows,
            actor.is_ending,
            actor.knows_end,
            actor.suspended[-1],
            len(set(actor.suspended)),
            *actor.known,
            list(actor.uses),
        ]
    )
    for place, request in actor.requests.items():
        walk.add([place, request.number, request.is_over, list(request.unread)])
    walk.add_time(actor, actor.late_at)


def _add_outcomes(walk: _Walk, play: Play) -> None:
    """How tasks ended that somebody can still ask for, or constrain."""
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


def _add_seen(walk: _Walk, play: Play, detail: Detail) -> tuple[int, ...]:
    """Add the state that properties see; return the messages in the order in which they were
    added.
    """
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
    """Add all of a message that properties see, and what the rules hold against it later."""
    walk.add(
        [item.id, item.parent_id, item.about, item.sent_by, item.never_began, item.has_resolved]
    )
    walk.add(
        [item.recovering, *(getattr(item, name) for name in SEEN if name not in OF_LAST_ACTION)]
    )
    walk.add([_out_of_time(hold, now) for hold in item.holds if not hold.is_over])


def _out_of_time(hold: Hold, now: float) -> list[Any]:
    """A constraint; if its delay has begun, with how much of that is left."""
    left = None if hold.due is None else round(hold.due - now, _DIGITS)
    return [hold.moment, hold.constraint.before, hold.constraint.delay if left is None else left]
