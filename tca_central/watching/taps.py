"""Wiretaps: central sends a listener when something happens to messages (TCA 8.5: msgTap.c).

Theory of operation. A tap fires before a moment or at an event. A tap that fires before a start
holds this start back until the listener's interval of the same kind has ended. A listener that
holds the tapped task, or checks its work, is a child of the tapped task. The listener's failure is
handled there, and the listener is killed with the task. A listener that holds nothing is a child of
the root, so that its failure is not the tapped task's failure. A monitor that watches the tapped
task is an exception: it is a child of that task. Messages sent for a tap are not tapped themselves.
"""

from collections.abc import Iterable

from msgspec.structs import replace

from tca_central.errors import RequestError
from tca_central.model.budget import ATTACHED_BYTES
from tca_central.model.contexts import Listening, listener_cause
from tca_central.model.deliveries import Connection, Delivery, MessageType, Module, Wiretap
from tca_central.model.intervals import unified
from tca_central.model.task_tree import first_moments, taps_of, to_be_fired
from tca_central.model.tasks import Tapping, Task, place_of
from tca_central.outgoing.central_messages import data_for, make_statement, make_task
from tca_central.state import State
from tca_central.watching.watches import (
    become_monitor,
    check_options,
    end_monitor,
    ends_by_itself,
    enlist_monitor,
)
from tca_wire.journal import facts
from tca_wire.messages.formats import NO_DATA, first_difference
from tca_wire.packets import headers
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    ROOT,
    START_HANDLING,
    STARTS,
    Moment,
    Point,
)
from tca_wire.rules import (
    CONDITIONS,
    DELIVERED,
    FAILURE,
    LISTENERS,
    REPLIED,
    SUCCESS,
    recurs_on_retry,
)
from tca_wire.vocabulary import CENTRAL, Condition, Refusal, Role

MOST_TAPS = 1000
"""Wiretaps of one message or task."""


_HELD_PLANNING = {
    Condition.BEFORE_PLANNING: "'before handling' also holds a goal's planning until it is handled",
    Condition.WHEN_PLANNED: "'after planned' sends it then, too",
}
"""Conditions that hold a goal until the listener is planned, with advice.

The advice is for listeners that are tasks but not goals: they have nothing to plan.
"""


# --- adding and removing --------------------------------------------------------------------------


def on_tap(central: State, connection: Connection, header: headers.Tap, _: bytes) -> None:
    """Tap a message, or one task, for a module."""
    place = _tapped_place(central, header)
    listener = central.registry.messages.get(header.listener)
    if listener is None:
        raise RequestError(Refusal.UNKNOWN, f"listener '{header.listener}' is not declared")
    tapped = place.message if isinstance(place, Task) else place
    _check(header.condition, tapped, listener)
    is_due = isinstance(place, Task) and _is_due(header, place)
    if listener.message_class.is_monitor:
        _check_monitor(central, header, tapped, listener)
    module = connection.module
    if isinstance(place, Task) and place.id not in central.tree.tasks:
        tap_id = _call_for_ended(central, module, header, listener, place)
        central.accept(connection, header.number, tap_id)
        return
    tap = _add(central, module, header, listener, tapped, place)
    tap.holders[module.name] = module.holder
    for other in [one for one in place.taps if one is not tap and module.name in one.holders]:
        if (other.condition, other.listener) == (tap.condition, listener):
            remove(central, other, module)  # the new tap replaces it: only the watch options differ
    _apply_to_waiting(central, tap)
    if is_due and isinstance(place, Task) and not tap.has_fired:
        _fire(central, tap, place, place.body)
    central.accept(connection, header.number, tap.id)


def _tapped_place(central: State, header: headers.Tap) -> Task | MessageType:
    """Return the message or task to tap. With ``at_once``, make a stand-in for an ended task."""
    if not header.message:
        task = central.tree.task(header.task)
        if task is None and header.at_once:
            task = _stand_in(central, header)
        if task is None:
            text = f"task {{{header.task}}} has ended: it can't be tapped"
            raise RequestError(Refusal.TOO_LATE, text)
        return task
    if header.at_once:
        text = f"message '{header.message}' can't be tapped at once: one task can"
        raise RequestError(Refusal.PROTOCOL, text)
    message = central.registry.messages.get(header.message)
    if message is None:
        text = f"'{header.message}' is not declared: it can't be tapped"
        raise RequestError(Refusal.UNKNOWN, text)
    return message


def _check(condition: Condition, tapped: MessageType, listener: MessageType) -> None:
    """Raise RequestError if the condition, the tapped message and the listener don't fit."""
    if tapped.message_class not in CONDITIONS[condition].classes:
        text = f"{tapped.title} can't be tapped '{condition}'"
        raise RequestError(
            Refusal.PROTOCOL, f"{text}: that never happens to messages of this class"
        )
    if listener.message_class not in LISTENERS or listener.is_notice:
        what = "notice" if listener.is_notice else listener.message_class
        which = "informs, broadcasts, goals, commands and monitors can"
        raise RequestError(Refusal.PROTOCOL, f"{what} '{listener.name}' can't listen: {which}")
    if (
        condition in _HELD_PLANNING
        and listener.message_class.is_task
        and not listener.message_class.is_goal
    ):
        text = f"{listener.title} has nothing to plan: '{condition}' it would not hold any planning"
        raise RequestError(
            Refusal.PROTOCOL,
            f"{text}; use a goal as listener, or note that {_HELD_PLANNING[condition]}",
        )
    data = tapped.format.reply if condition is Condition.AFTER_REPLIED else tapped.format.data
    difference = (
        first_difference(listener.format.data, data) if listener.format.data != NO_DATA else ""
    )
    if difference:
        text = f"listener '{listener.name}' needs other data than '{tapped.name}' has: {difference}"
        raise RequestError(
            Refusal.FORMAT, f"{text} (here = the listener, there = the tapped message)"
        )


def _is_due(header: headers.Tap, task: Task) -> bool:
    """Whether to send the listener now, because the condition has already come true.

    Raises RequestError if the condition can't come true any more, and the listener can't be sent
    now. A start of handling can still come true: a retry starts the handling again.
    """
    condition, rule = header.condition, CONDITIONS[header.condition]
    if header.at_once:
        _check_at_once(condition)
        if _has_happened(condition, task):
            return True
    moments = (rule.held_moment | rule.at) & ALL_MOMENTS & ~START_HANDLING
    is_killed = condition is Condition.WHEN_KILLED and bool(task.killed)
    if (
        condition is Condition.WHEN_SENT
        or is_killed
        or task.reached == ALL_MOMENTS
        or task.reached & moments
    ):
        how = "it was killed" if task.killed and not is_killed else "that is past"
        raise RequestError(
            Refusal.TOO_LATE, f"{task} can't be tapped '{condition}' any more: {how}"
        )
    return False


def _check_at_once(condition: Condition) -> None:
    """Raise RequestError if a listener can't be sent after its condition came true."""
    rule, text = CONDITIONS[condition], f"'{condition}' can't be called at once"
    if rule.holds_until:
        raise RequestError(
            Refusal.PROTOCOL, f"{text}: it holds back later steps; use a 'while' condition"
        )
    if rule.at & (SUCCESS | FAILURE | REPLIED):
        raise RequestError(Refusal.PROTOCOL, f"{text}: it is not stored; use 'after handled'")


def _has_happened(condition: Condition, task: Task) -> bool:
    """Whether a condition has come true for a task. A "while" condition must hold now."""
    rule = CONDITIONS[condition]
    if condition is Condition.WHEN_SENT:
        return True
    if task.killed or condition is Condition.WHEN_KILLED:
        return condition is Condition.WHEN_KILLED and bool(task.killed)
    if condition is Condition.WHILE_HANDLING:
        # A handling that is to be retried does not count. Its monitor would keep the task from its
        # next handling, and would itself wait for the end of that handling.
        return task.is_running and not task.retry_pending
    moments = (
        END_HANDLING
        if condition is Condition.AFTER_HANDLED
        else (rule.held_moment | rule.at) & ALL_MOMENTS
    )
    return bool(task.reached & moments) and not task.reached & rule.lasts_until


def _stand_in(central: State, header: headers.Tap) -> Task | None:
    """Return a stand-in for a task that has ended; None if central knows too little about it."""
    memory = central.memory
    outcome, record = memory.outcome_of(header.task), memory.records.get(header.task)
    message = record.message if record is not None else central.registry.messages.get(header.of)
    if outcome is None or message is None or not message.message_class.is_task:
        return None
    task = Task(header.task, message, record.body if record is not None else b"", None)
    task.reached, task.returned = ALL_MOMENTS, True
    task.killed = "" if outcome[0].lets_successors_continue else str(outcome[0])
    return task


def _call_for_ended(
    central: State, by: Module, header: headers.Tap, listener: MessageType, task: Task
) -> int:
    """Send the listener of a wiretap on a task that has ended, with its retained data.

    Return the tap's id.
    """
    if listener.format.data != NO_DATA and task.id not in central.memory.records:
        advice = (
            "send the task with keep=True, or tap it with a listener that is declared without data"
        )
        raise RequestError(
            Refusal.TOO_LATE, f"{task} has ended, and its data was not kept: {advice}"
        )
    tap = Wiretap(central.new_id(), header.condition, listener, task)
    tap.watch = header.watch
    central.facts.append(
        facts.TapAdded(
            tap.id, tap.condition, listener.name, task.message.name, header.task, by.name
        )
    )
    _fire(central, tap, task, task.body)
    return tap.id


def _check_monitor(
    central: State, header: headers.Tap, tapped: MessageType, listener: MessageType
) -> None:
    """Raise RequestError if a monitor that listens with this condition would never end."""
    options = header.watch or WatchOptions()
    check_options(central, listener, options)
    rule = CONDITIONS[header.condition]
    ends_with_it = tapped.message_class.is_task and rule.is_before_end and not rule.is_child
    if not (ends_with_it or ends_by_itself(listener, options) or options.waited_for):
        text = f"{listener.title} that listens '{header.condition}' would never end"
        hint = (
            "limit its actions, duration or end point, or give waited_for=True if a module ends it"
        )
        raise RequestError(Refusal.PROTOCOL, f"{text}: {hint}")


def _add(
    central: State,
    by: Module,
    header: headers.Tap,
    listener: MessageType,
    tapped: MessageType,
    place: Task | MessageType,
) -> Wiretap:
    """Add a tap and return it. If there is an equal tap, with equal options, return that tap."""
    condition = header.condition
    others = Tapping.of(place).taps if isinstance(place, Task) else place.taps
    for other in others:
        if (other.condition, other.listener, other.watch) == (condition, listener, header.watch):
            return other
    if len(others) >= MOST_TAPS:
        raise RequestError(Refusal.OVERLOAD, f"{place} has {MOST_TAPS} wiretaps already")
    central.check_declared(ATTACHED_BYTES)
    tap = Wiretap(central.new_id(), condition, listener, place)
    rule = CONDITIONS[condition]
    tap.held_moment, tap.at, tap.watch = rule.held_moment, rule.at, header.watch
    if rule.held_moment and not tapped.message_class.is_task:
        tap.held_moment, tap.at = 0, DELIVERED  # only a task can be held
    others.append(tap)
    central.taps[tap.id] = tap
    if tap.at & DELIVERED:
        # A prefetched message would start before central could send the listener.
        for handler in tapped.handlers:
            central.dispatcher.prefetcher.recall(handler.resource)
    task = place.id if isinstance(place, Task) else ROOT
    central.facts.append(
        facts.TapAdded(tap.id, condition, listener.name, tapped.name, task, by.name)
    )
    return tap


def remove(central: State, tap: Wiretap, by: Module, *, for_all: bool = False) -> None:
    """Remove a module from the holders of a tap.

    The tap stays while another program, or a connected copy of the same program, holds it. With
    *for_all* the tap is removed at once.
    """
    tap.holders.pop(by.name, None)
    others = () if for_all else tap.holders.values()
    if any(one.called != by.called or one.run in central.registry.modules for one in others):
        return
    tap.place.taps.remove(tap)
    del central.taps[tap.id]
    central.facts.append(facts.Removed(tap.id, by.name))


def forget_task(central: State, task: Task) -> None:
    """Forget the taps of a task that has ended."""
    for tap in task.taps:
        del central.taps[tap.id]


# --- waiting messages -----------------------------------------------------------------------------


def _apply_to_waiting(central: State, tap: Wiretap) -> None:
    """Apply a new wiretap to tasks that wait for a handler."""
    for task in _queued_tasks(central, tap):
        if tap not in to_be_fired(task, first_moments(task)):
            continue
        if tap.is_heard:
            _requeue(central, task)
        else:
            fire_before(central, task, [tap])


def on_listeners_added(central: State, names: Iterable[str]) -> None:
    """Apply taps to waiting tasks when the listeners, called *names*, get their first handler."""
    added = [central.registry.messages[name] for name in names]
    new = {message for message in added if not message.handlers}
    for tap in central.taps.values() if new else ():
        if tap.listener in new:
            for task in _queued_tasks(central, tap):
                if task.tapping is not None and task.tapping.fired.get(tap.id) is False:
                    _requeue(central, task)


def _queued_tasks(central: State, tap: Wiretap) -> list[Task]:
    """Return the tasks in queues that the tap can hold, oldest first."""
    if not tap.held_moment & STARTS:
        return []
    place = place_of(tap)
    if isinstance(place, Task):
        return [place] if place.queues is not None else []
    return [one for one in central.dispatcher.queued(place) if isinstance(one, Task)]


def _requeue(central: State, task: Task) -> None:
    """Reconsider a task that waits for a handler. The task keeps its place in the queue."""
    central.dispatcher.withdraw(task, keep_place=True)
    central.agenda.recheck_start(task)


# --- firing ---------------------------------------------------------------------------------------


def fire_after(central: State, tapped: Delivery, events: int, body: bytes | None = None) -> None:
    """Fire the taps of a message for *events*, with the message's data.

    With *body*, the reply, fire only the taps that listen for a reply.
    """
    if not central.taps:
        return
    for tap in taps_of(tapped):
        is_reply = tap.condition is Condition.AFTER_REPLIED
        if tap.at & events and is_reply == (body is not None):
            _fire(central, tap, tapped, tapped.body if body is None else body)


def fire_before(central: State, task: Task, taps: list[Wiretap]) -> None:
    """Fire taps before a task continues, and hold the task until their listeners are done."""
    assert not task.killed, f"{task}: killed between its request to continue and this"
    for tap in taps:
        if tap.id not in central.taps:
            continue
        listener = _fire(central, tap, task, task.body)
        # False means that the tap fires again when the listener has a handler.
        Tapping.of(task).fired[tap.id] = listener is not None or bool(tap.listener.handlers)
        end = CONDITIONS[tap.condition].holds_until
        if not isinstance(listener, Task) or not end or listener.reached & end:
            continue
        # A retried task has reached all its starts. Only its next handling can be held.
        is_retried = tap.held_moment == START_HANDLING and bool(task.reached & START_HANDLING)
        moment = START_HANDLING if is_retried else unified(task.is_goal, tap.held_moment)
        if is_retried or not task.reached & moment:
            central.agenda.holds.hold(listener, end, task, moment)
    central.agenda.taps_fired(task)


def _fire(central: State, tap: Wiretap, tapped: Delivery, body: bytes) -> Delivery | None:
    """Send the listener of a tap, if it has a handler. Return the listener."""
    message, body = tap.listener, data_for(tap.listener, body)
    if not tap.is_heard or _refuse_listener(central, tap, tapped, body):
        central.facts.append(facts.TapFired(tap.id, tapped.message_id, 0))
        return None
    listener: Delivery
    if message.message_class.is_task:
        listener = _make_task(central, tap, tapped, body)
    else:
        context = Listening(tap, tapped)
        listener = make_statement(
            central, message, body, Role.LISTENER, about=tapped, context=context
        )
    tap.has_fired = isinstance(tap.place, Task)
    central.facts.append(facts.TapFired(tap.id, tapped.message_id, listener.id))
    return listener


def _refuse_listener(central: State, tap: Wiretap, tapped: Delivery, body: bytes) -> bool:
    """Refuse a listener if there is no room, or if its chain of taps is too long.

    Returns whether it was refused.
    """
    message = tap.listener
    # A refusal here is rare: usually the request that starts such a chain is refused.
    if max(tapped.tap_depth, central.tap_depth) >= central.budget.tap_depth:
        message.dropped += 1
        central.facts.append(
            facts.RequestRefused(CENTRAL, Refusal.OVERLOAD, central.why_too_deep(tap, tapped))
        )
        return True
    return message.message_class.is_task and central.refuse_own_task_if_full(
        f"listener '{message.name}' of {tapped}", body
    )


def _make_task(central: State, tap: Wiretap, tapped: Delivery, body: bytes) -> Task:
    """Make a listener that is a task."""
    message, rule = tap.listener, CONDITIONS[tap.condition]
    task = tapped if isinstance(tapped, Task) else None
    is_alive = tapped.id in central.tree.tasks
    watches_it = message.is_interval_monitor and rule.is_before_end and not rule.is_child
    parent = (
        task
        if task is not None and is_alive and (rule.is_child or watches_it)
        else central.tree.root
    )
    options = tap.watch or WatchOptions()
    is_bounded = ends_by_itself(message, options) or options.waited_for
    if task is not None and rule.lasts_until:
        _end_earlier_monitors(central, tap, task)
    if task is not None and watches_it and ((rule.lasts_until and not is_bounded) or not is_alive):
        options = replace(options, until=Point(task.id, Moment(rule.lasts_until or END_ACHIEVING)))

    def prepare(listener: Task) -> None:
        """Set what the listener must have before it enters the tree."""
        if message.message_class.is_monitor:
            is_foreign_monitor = (
                watches_it and parent is task and not recurs_on_retry(tap.condition)
            )
            become_monitor(central, listener, options, is_foreign_monitor=is_foreign_monitor)
        listener.is_background = listener.is_background and not rule.is_child

    context = Listening(tap, tapped)
    listener = make_task(
        central,
        message,
        body,
        parent,
        Role.LISTENER,
        about=tapped,
        context=context,
        prepare=prepare,
    )
    enlist_monitor(central, listener)
    if task is not None and rule.lasts_until:
        Tapping.of(task).listeners.append(listener)
    return listener


def _end_earlier_monitors(central: State, tap: Wiretap, tapped: Task) -> None:
    """End the monitors that a wiretap has sent for earlier handlings of a task."""
    tapping = Tapping.of(tapped)
    tapping.listeners = [one for one in tapping.listeners if one.reached != ALL_MOMENTS]
    for other in tapping.listeners:
        if listener_cause(other).tap is tap and other.watch is not None:
            end_monitor(central, other.watch, f"{tapped} is handled again")
