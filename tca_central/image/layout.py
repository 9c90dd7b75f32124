"""The layout of images: every class whose objects the state of central may consist of, with its attributes.

An image names classes and attributes, and only those listed here are read or written. Whoever adds an attribute to a
class of the state adds it here, raises FORMAT if an image of a released version can't be read any more, and writes the
frozen layout anew (tests/central/test_images.py).
"""

from collections import OrderedDict, deque
from enum import Enum
from typing import Any, get_args

import msgspec

from tca_central.control.steering import PendingDeadline, PendingKill
from tca_central.core import Central
from tca_central.events import AccessRule
from tca_central.image.shapes import (
    ObjectShape,
    ValueShape,
    constants,
    frozen,
    listed,
    long_tuples,
    mapping,
    members,
    names,
    record,
    tuples,
)
from tca_central.model.answers import KeptAnswers
from tca_central.model.budget import Budget
from tca_central.model.clock import Clock, Timer
from tca_central.model.deliveries import (
    AttachedHandler,
    Blocking,
    Connection,
    Delivery,
    Handler,
    Holder,
    LostClaim,
    MessageType,
    Module,
    ModuleResource,
    Refusals,
    Wiretap,
)
from tca_central.model.observers import Observation, Observers
from tca_central.model.registry import Registry, Value, Variables
from tca_central.model.resources import Claim, PendingLimit, Queue
from tca_central.model.rights import Permissions, Rights
from tca_central.model.task_tree import ClientRequest, KeptTask, Rare, Task, TaskTree, Verdict
from tca_central.order.agenda import Agenda
from tca_central.order.ahead import MessagesAhead
from tca_central.order.dispatcher import Dispatcher
from tca_central.order.holds import Holds, PendingDelay
from tca_central.state import Collector, FailureContext, PresenceWait, RaisedFailure, RestartHold, TaskWait
from tca_central.watching.taps import Listening
from tca_central.watching.watches import Watch
from tca_wire.constraints import Constraint, Flags
from tca_wire.journal.facts import Dropped
from tca_wire.packets import headers, parts
from tca_wire.packets.routes import Entrance
from tca_wire.points import Moment, Point
from tca_wire.rules import GOAL, NO_GOAL, TaskRules
from tca_wire.vocabulary import (
    Busy,
    Condition,
    Dropping,
    Due,
    MessageClass,
    Outcome,
    Party,
    Permission,
    Refusal,
    Role,
    Scope,
)

FORMAT = 1
"""The version of the layout, and of how it is written."""

_DELIVERY = (
    "arrival body context given_as id message message_id nested number origin priority queues refused role sender "
    "sent_by since slot tap_depth ticket"
)
_RESOURCE = (
    "_free _queue _sent_by ahead ahead_at called_back claims copies held_by is_recalling module name numbers slots"
)

OBJECTS: dict[type, str] = {
    Central: (
        "agenda answers attached blocked budget claimed_for claims clock collectors dispatcher epoch events facts "
        "failed forgotten hold is_disk_low keep_count kept kept_bytes look_after lost may_have_closed messages "
        "next_look observers origin outcome_bytes outcomes registry scan suspects taps tree untold variables "
        "watch_of_condition watches"
    ),
    # model
    AttachedHandler: "by failure handler holders id maximum place",
    Budget: (
        "answers awaited collected declared kept messages outcomes refused tap_depth task_depth total unread variables"
    ),
    Claim: "admits_owner arrival holder id number owner priority resource since slot ticket timer",
    Clock: "_asked _cancelled _queue now",
    Connection: (
        "answer_bytes answers begins doubts entrance handling hung_after id known_until last_number late licence "
        "lost_claims module number orphans outstanding pauses prefetch principal pulse repeats_until resource rights "
        "routes session tasks unbegun untold waits was_replaced watchers watches"
    ),
    Delivery: _DELIVERY,
    Handler: "accepts busy direct message module pending pool refuses resource takes",
    KeptAnswers: "_kept bytes forgotten most",
    KeptTask: "body id kept kept_by message outcome parent role",
    MessageType: (
        "attached awaited_by candidates declarers delivered dropped failed fans_out first_declared_by format handlers "
        "initial is_aside is_goal is_notice message_class name parts route rules running senders_told serving taps "
        "waiting wishes"
    ),
    Module: "called connections handlers incarnation is_ready keeps name principal process resources",
    ModuleResource: f"{_RESOURCE} busy delivered limits quick_runs replaced",
    PendingLimit: "most waiting",
    Observation: "below connection is_awaited message number origin states task_id told",
    Observers: "count of_message of_task others",
    Queue: "_heap waiting",
    Permissions: "barred licences newest_licence outcome_owners rules",
    Rights: "known patterns",
    Rare: (
        "asked attached attempts client_serial ended_followers farewells fired guests invocations is_guest "
        "is_resolved is_tapped is_void kept kept_by listeners pending progress recovering retry_askers retry_targets "
        "taps unheard watch"
    ),
    Registry: "_names bytes connections dropped look_after lost messages modules permissions",
    Task: (
        f"{_DELIVERY} "
        "children delayed depth failure followers held ignores_parent is_dealt_with is_goal is_watcher killed "
        "last_child leaders parent rare reached requested result retrying returned serial size state "
        "survives suspended unplanned waiters watchers"
    ),
    TaskTree: "across bytes last_of_module never_began newest root suspended tasks top_of_module",
    Timer: "due is_cancelled subject time",
    Variables: "bytes values",
    Wiretap: "at before condition has_fired holders id listener place watch",
    # order
    Agenda: (
        "_facts ended ended_waits holds look_at only_watched resumed startable tap_events taps_to_fire tree unanswered "
        "waits withdrawn"
    ),
    Dispatcher: (
        "_arrivals _clock _facts _out _suspects bytes changed crowded displaced granted handlers is_holding "
        "messages_ahead running stranded to_offer"
    ),
    Holds: "_clock _facts edges ending tree",
    MessagesAhead: "_clock _out trusts_all",
    PendingDelay: "constraint moment task",
    # what is waited for, or about to happen
    Collector: "answered connection end failures id message module_of number origin pending wanted",
    RestartHold: "awaited grace until_told",
    FailureContext: "at attached failing failure passed",
    Listening: "tap tapped",
    PendingDeadline: "moment seconds task",
    PendingKill: "delay scope task verdict",
    PresenceWait: "connection messages missing number origin promised",
    TaskWait: "connection moment number origin task_id",
    Watch: "activations began condition count fires holds is_over options parts since task timers waits_for",
}
"""Classes of objects that change, each with its attributes."""

DERIVED: dict[type, set[str]] = {Central: {"_output_queues", "_outputs"}}
"""Attributes that are made anew (Central.connect_outputs)."""

VALUES: tuple[type, ...] = (
    AccessRule, ClientRequest, Blocking, Constraint, Dropped, Entrance, Holder, LostClaim, Point, RaisedFailure,
    Refusals, Value, Verdict, parts.Involved, parts.MessageFormat, parts.Tapped, parts.Trouble, parts.Watching,
    parts.WatchOptions,
    *get_args(headers.ToModule),
)  # fmt: skip
"""Classes of values that never change: NamedTuples and msgspec's. They have the fields that they declare."""

ENUMS: tuple[type[Enum], ...] = (
    Busy, Condition, Dropping, Due, Flags, MessageClass, Moment, Outcome, Party, Permission, Refusal, Role, Scope,
)  # fmt: skip

LONGEST_RECORD = 8
"""Tuples that are longer are written as lists are."""


def _fields(kind: Any) -> tuple[str, ...]:
    fields: tuple[str, ...] = kind.__struct_fields__ if issubclass(kind, msgspec.Struct) else kind._fields
    return fields


OBJECT_SHAPES: dict[object, ObjectShape] = {
    **{kind: record(kind, tuple(fields.split()), DERIVED.get(kind, ())) for kind, fields in OBJECTS.items()},
    list: listed("list", list, list.extend),
    (deque, None): listed("deque", deque, deque.extend),
    set: names(),
    dict: mapping(dict),
    OrderedDict: mapping(OrderedDict),
}
VALUE_SHAPES: dict[object, ValueShape] = {
    **{kind: frozen(kind, _fields(kind)) for kind in VALUES},
    **{(tuple, length): tuples(length) for length in range(LONGEST_RECORD + 1)},
    tuple: long_tuples(),
    **{kind: members(kind) for kind in ENUMS},
    TaskRules: constants(TaskRules, {"GOAL": GOAL, "NO_GOAL": NO_GOAL}),
}


def shape_key(thing: Any) -> object:
    """The key of a thing's shape."""
    kind = type(thing)
    if kind is tuple:
        return (tuple, len(thing)) if len(thing) <= LONGEST_RECORD else tuple
    return (deque, thing.maxlen) if kind is deque else kind


def group_key(thing: Any) -> object:
    """The key of those that are written together. Containers go by what they hold: so most columns hold one class."""
    kind = type(thing)
    if kind is tuple:
        return tuple(map(type, thing)) if len(thing) <= LONGEST_RECORD else tuple
    if kind is dict:
        return next(((dict, type(key), type(value)) for key, value in thing.items()), dict)
    if kind is list:
        return (list, type(thing[0])) if thing else list
    return (deque, thing.maxlen) if kind is deque else kind
