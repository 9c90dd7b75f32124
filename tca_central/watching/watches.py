"""The start and the end of monitors. control/monitors.py has the rules for their watching."""

from tca_central.errors import RequestError
from tca_central.model.clock import checked_seconds
from tca_central.model.contexts import listener_cause, monitor_of
from tca_central.model.deliveries import MessageType
from tca_central.model.tasks import Task, Watch
from tca_central.outgoing.central_messages import data_for, make
from tca_central.state import State, dropped_fact
from tca_wire.journal import facts
from tca_wire.packets.parts import WatchOptions
from tca_wire.rules import RETURNED, recurs_on_retry
from tca_wire.vocabulary import Refusal, Role

SHORTEST_PERIOD = 0.001
"""The least number of seconds between two tests of a condition."""

_CANCEL = 2  # the index of a demon monitor's cancel message


def on_end_point(central: State, watch: Watch, _: Task) -> None:
    """End a monitor whose end point is reached."""
    watch.waits_for = None
    end_monitor(central, watch, "its end point is reached")


def check_options(central: State, message: MessageType, options: WatchOptions) -> None:
    """Raise RequestError if a monitor can't watch with these options."""
    polls = message.message_class.has_condition and message.is_interval_monitor
    what = message.title
    checked_seconds(options.duration, f"{what} with a duration")
    if polls:
        checked_seconds(options.period, f"{what} with a period")
    if polls and options.period < SHORTEST_PERIOD:
        text = (
            f"{what} with a period of {options.period:g} s: {SHORTEST_PERIOD:g} s is the shortest"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    if options.fire_every < 1 or options.maximum < 0:
        often = f"that fires every {options.fire_every} times, at most {options.maximum}"
        text = f"{what} {often}: 1 and 0 are the lowest"
        raise RequestError(Refusal.PROTOCOL, text)
    if options.until is not None:
        central.agenda.holds.place(options.until)  # raises if there is no such point


def ends_by_itself(message: MessageType, options: WatchOptions) -> bool:
    """Whether a monitor has an end of its own. A point monitor has, since it tests only once."""
    is_bounded = options.maximum or options.duration or options.until is not None
    return bool(is_bounded) or not message.is_interval_monitor


def become_monitor(
    central: State, task: Task, options: WatchOptions, *, is_foreign_monitor: bool
) -> None:
    """Make a new task a monitor. ``check_options`` must have passed."""
    parts = [central.registry.messages.get(part) for part in task.message.parts]
    task.watch = Watch(task, options, parts, is_foreign_monitor=is_foreign_monitor)
    task.is_background = task.message.is_interval_monitor and not options.waited_for


def enlist_monitor(central: State, task: Task) -> None:
    """Add a new monitor, now in the tree, to the list of monitors. Leave out a killed monitor."""
    if task.watch is not None and not task.killed:
        central.watches[task.id] = task.watch


def is_foreign(central: State, parent: Task, origin: int) -> bool:
    """Whether a monitor under *parent* was not sent by the handling of *parent*.

    A retry of *parent* does not end such a monitor, because the next handling would not send the
    monitor again. *origin* is the delivery whose handler sends the monitor (0: none).

    The search follows the causes of *origin* back to *parent*. Three kinds of messages are not part
    of the handling: exception handlers, messages of foreign monitors, and listeners that a retry
    does not send again. Each step leads to an older delivery. The search ends at *parent*, or at a
    delivery that is older than *parent*.
    """
    cause = central.dispatcher.running.get(origin)
    is_own = origin == parent.handling_id
    while cause is not None and cause.id >= parent.id and not is_own:
        if cause.role is Role.LISTENER:
            heard = listener_cause(cause)
            tapped, tap = central.tree.tasks.get(heard.tapped.task), central.taps.get(heard.tap.id)
            if tapped is parent:
                return tap is None or not recurs_on_retry(tap.condition)
            cause = tapped
        elif cause.role.is_of_monitor:
            cause = monitor_of(cause).task
        elif isinstance(cause, Task):
            cause = (
                None if cause.role is Role.EXCEPTION or cause.is_foreign_monitor else cause.parent
            )
        else:  # only older causes count: modules may report wrong origins, and the search must end
            is_own = cause.origin == parent.handling_id
            cause = (
                central.dispatcher.running.get(cause.origin) if cause.origin < cause.id else None
            )
        is_own = is_own or cause is parent
    return not is_own


def stop_watching(central: State, watch: Watch, why: str) -> None:
    """Stop watching. Messages that the monitor has sent continue."""
    if watch.is_over:
        return
    watch.is_over = True
    central.watches.pop(watch.task.id, None)
    for timer in watch.timers.values():
        central.clock.cancel(timer)
    if watch.waits_for is not None:
        central.agenda.stop_waiting(watch.waits_for, watch)
        watch.waits_for = None
    if (condition := watch.condition) is not None:
        watch.condition = None
        if condition.queues is not None:
            central.dispatcher.withdraw(condition)
            central.facts.append(dropped_fact(condition, "its monitor has ended"))
        del central.watch_of_condition[condition.id]
    if watch.watching_since is None:
        return
    central.facts.append(facts.MonitorEnded(watch.task.id, why))
    central.agenda.tap_events.append((watch.task, RETURNED))
    has_condition = watch.task.message.message_class.has_condition
    if not has_condition and (cancel := watch.parts[_CANCEL]) is not None:
        body = data_for(cancel, watch.task.body)
        make(central, cancel, body, watch.task, Role.CANCEL, context=watch)


def end_monitor(central: State, watch: Watch, why: str) -> None:
    """Complete a monitor, and record why. A monitor that has not started yet never starts."""
    if not watch.is_over:
        if watch.watching_since is None:
            central.facts.append(facts.MonitorEnded(watch.task.id, why))
        stop_watching(central, watch, why)
        if not watch.task.killed:
            central.agenda.mark_returned(watch.task)
