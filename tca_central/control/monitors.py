"""Monitors: tasks that central carries out itself (TCA 8.5 manual, chapter on monitors).

A *point monitor* tests its condition once, when its turn comes. A *polling monitor* tests it every
period. A *demon monitor* may send a set-up message, and waits to be fired. Modules may fire all
kinds: a demon monitor then acts, the others test once more.

When a condition holds, or a demon monitor is fired, the monitor sends its action as its child. The
action's data are the condition's reply or, if the reply is just true, the monitor's own data. An
action that is declared without data gets none.

A polling or demon monitor ends after a number of actions, after some seconds, or at a point. A
*background monitor*, for which its parent does not wait, ends at the latest when only such monitors
are left under the parent.
"""

from tca_central.errors import RequestError
from tca_central.failing.failures import fail_task, kill, raise_failure
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import Connection
from tca_central.model.tasks import Task, Verdict, Watch
from tca_central.outgoing.central_messages import data_for, make, make_delivery, reason_to_refuse
from tca_central.state import State
from tca_central.watching.watches import end_monitor, enlist_monitor, stop_watching
from tca_wire.journal import facts
from tca_wire.messages.failures import OVERLOAD
from tca_wire.messages.formats import NIL, NO_DATA
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer
from tca_wire.packets.parts import MessageFormat
from tca_wire.points import START_HANDLING, Point, TaskId
from tca_wire.rules import DELIVERED
from tca_wire.vocabulary import Due, MessageClass, Outcome, Refusal, Role

FALSE, TRUE = b"\xc2", b"\xc3"  # the replies False and True as MessagePack

_FIRST, _ACTION = 0, 1  # indices of a monitor's parts
_ALL_ELSE = "all else under its parent has ended"


# --- declaration ----------------------------------------------------------------------------------


def check_parts(central: State, declared: MessageFormat, new: dict[str, MessageClass]) -> None:
    """Raise RequestError if a declared message does not have the parts that its class needs.

    *new* has the classes of the messages that the same request declares.
    """
    message_class = declared.message_class
    wanted = 0
    if message_class.is_monitor:
        wanted = 2 if message_class.has_condition else 3
    if len(declared.parts) != wanted:
        text = (
            f"{message_class} '{declared.name}' has {len(declared.parts)} parts, and needs {wanted}"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    for number, part in enumerate(declared.parts):
        known = central.registry.messages.get(part)
        part_class = new.get(part) or (known.message_class if known else None)
        is_condition = number == _FIRST and message_class.has_condition
        is_query = part_class is not None and part_class.asks_one
        is_fit = (
            is_query
            if is_condition
            else part == "" or (part_class is not None and part_class.may_react)
        )
        if not is_fit:
            what = f"a {part_class}" if part_class else "not declared"
            which = "a query" if is_condition else "a goal, command, inform or broadcast"
            text = f"{message_class} '{declared.name}' needs {which}, and '{part}' is {what}"
            raise RequestError(Refusal.UNKNOWN, text)


# --- watching -------------------------------------------------------------------------------------


def start(central: State, task: Task) -> None:
    """Start a monitor whose turn has come, so that it watches."""
    watch = _watch_of(task)
    if task.returned:  # it was ended before it started
        central.agenda.mark_started(task)
        return
    if watch.is_over:  # a retry
        watch = task.watch = Watch(
            task, watch.options, watch.parts, is_foreign_monitor=watch.is_foreign_monitor
        )
        enlist_monitor(central, task)
    watch.watching_since = watch.periods_from = central.clock.now
    central.agenda.mark_started(task)
    central.accept_for_handler(task)
    central.agenda.tap_events.append((task, DELIVERED))
    options, message_class = watch.options, task.message.message_class
    if options.duration:
        watch.timers[Due.MONITOR_OVER] = central.clock.after(
            options.duration, Due.MONITOR_OVER, watch
        )
    if options.until is not None and not _register_end_point(central, watch, options.until):
        return
    if not message_class.has_condition:
        if (set_up := watch.parts[_FIRST]) is not None:
            make(central, set_up, data_for(set_up, task.body), task, Role.SET_UP, context=watch)
    elif message_class.is_interval_monitor and options.initial_wait:
        _test_later(central, watch)
    else:
        _test(central, watch)


def _watch_of(task: Task) -> Watch:
    assert task.watch is not None
    return task.watch


def _register_end_point(central: State, watch: Watch, until: Point) -> bool:
    """Register a monitor's end point. If it is reached already, end the monitor; return False."""
    awaited = central.tree.tasks.get(until.task)
    if awaited is None or awaited.reached & int(until.moment):
        end_monitor(central, watch, "its end point is reached")
        return False
    watch.waits_for = awaited
    central.agenda.add_waiter(awaited, int(until.moment), watch)
    return True


def _test_later(central: State, watch: Watch) -> None:
    """Schedule a test for the next multiple of the period. Missed tests are not made up for."""
    period = watch.options.period
    wait = period - (central.clock.now - watch.periods_from) % period
    # A very short wait is a rounding error: now is the multiple, and the next one counts. A wait of
    # 0 would repeat for ever.
    if wait < period / 1000:
        wait += period
    central.clock.cancel(watch.timers.get(Due.TEST))
    watch.timers[Due.TEST] = central.clock.after(wait, Due.TEST, watch)


def on_test(central: State, watch: Watch) -> None:
    """Test a polling monitor whose period is over.

    No test is made while the monitor is suspended, or while its condition is being asked.
    """
    if not watch.is_on:
        return
    if watch.condition is not None or watch.task.suspended:
        _test_later(central, watch)
    elif not _test_if_owed(central, watch):
        _test(central, watch)


def _test_if_owed(central: State, watch: Watch) -> bool:
    """Make a test that is owed because a module fired the monitor. Return whether it was made now.

    The test starts the monitor's period again. A suspended polling monitor makes the test when it
    is resumed. If the condition can't be asked, the next period makes the test.
    """
    if not watch.tests_owed or (watch.task.message.is_interval_monitor and watch.task.suspended):
        return False
    watch.periods_from = central.clock.now
    _test(central, watch)
    watch.tests_owed -= watch.condition is not None
    return True


def proceed(central: State, task: Task) -> None:
    """Make the test of a resumed monitor that was fired while it was suspended."""
    watch = _watch_of(task)
    if watch.is_on and watch.condition is None:
        _test_if_owed(central, watch)


def _test(central: State, watch: Watch) -> None:
    """Ask a monitor's condition, and schedule a polling monitor's next test."""
    query, task = watch.parts[_FIRST], watch.task
    assert query is not None
    if task.message.is_interval_monitor:
        _test_later(central, watch)
    if why := reason_to_refuse(central, query, data_for(query, task.body)):
        if not task.message.is_interval_monitor:  # a point monitor has no later test
            stop_watching(central, watch, "its condition could not be asked")
            text = f"its condition '{query.name}' could not be asked: {why}"
            fail_task(central, task, RaisedFailure(OVERLOAD, text))
        return
    asked = make_delivery(
        central, query, data_for(query, task.body), Role.CONDITION, about=task, context=watch
    )
    watch.condition = asked
    central.watch_of_condition[asked.id] = watch
    central.dispatcher.route(asked)


def on_condition_answered(
    central: State, watch: Watch, answer: Answer, body: bytes, kinds: tuple[str, ...]
) -> None:
    """Act on the answer of a condition. The replies None and False mean: it does not hold.

    A failure of the condition is the monitor's failure.
    """
    watch.condition = None
    task = watch.task
    is_point = not task.message.is_interval_monitor
    if answer.outcome is not Outcome.DONE:
        text = f"its condition: {answer.text}" if answer.text else "its condition failed"
        failure = RaisedFailure(answer.failure, text, body, kinds)
        if is_point:
            stop_watching(central, watch, "its condition failed")
            fail_task(central, task, failure)
        else:
            raise_failure(central, task, failure)
    else:
        watch.last_result = holds = body not in (NIL, FALSE)
        central.facts.append(facts.MonitorTested(task.id, holds))
        if holds:
            _fire(central, watch, task.body if body == TRUE else body)
    if watch.is_on and not _test_if_owed(central, watch) and is_point:
        end_monitor(central, watch, "it has been tested")


def _fire(central: State, watch: Watch, body: bytes) -> None:
    """Send a monitor's action at each ``fire_every``-th call. After the last action, end it."""
    options = watch.options
    watch.times_met += 1
    if watch.times_met % options.fire_every:
        return
    action = watch.parts[_ACTION]
    if action is not None:
        body = data_for(action, body)
        if action.message_class.is_task and central.refuse_own_task_if_full(
            f"action '{action.name}' of {watch.task}", body
        ):
            return
        make(central, action, body, watch.task, Role.ACTION, context=watch)
    watch.actions_sent += 1
    if watch.actions_sent == options.maximum:
        end_monitor(central, watch, f"it has sent {watch.actions_sent} actions")


def on_fire(central: State, connection: Connection, header: headers.Fire, body: bytes) -> None:
    """Fire a monitor, or all monitors of a message, for a module.

    Monitors that do not watch are not fired (TCM: a warning, no effect).
    """
    if header.message:
        watches = _watches_of(central, header.message)
    else:
        watch = _requested_watch(central, header.monitor)
        watches = [watch] if watch is not None else []
    for watch in watches:
        _check_fire(watch, header.action, body)
    watching = [watch for watch in watches if watch.is_on]
    if not watching:
        state = "does not watch yet" if watches and not watches[0].is_over else "has ended"
        text = (
            f"no monitor '{header.message}' watches"
            if header.message
            else f"monitor {{{header.monitor}}} {state}"
        )
        central.ignore(connection, header.number, f"{text}: it can't be fired")
        return
    for watch in watching:
        if not watch.task.message.message_class.has_condition:
            _fire(central, watch, body)
        elif watch.is_on:  # the failure of an earlier monitor may have ended this one
            watch.tests_owed += 1
            if watch.condition is None:
                _test_if_owed(central, watch)
    central.accept(connection, header.number, watching[0].task.id)


def _watches_of(central: State, name: str) -> list[Watch]:
    """Return the living monitors of a message. Raise RequestError if it is not a monitor."""
    message = central.registry.messages.get(name)
    if message is None or not message.message_class.is_monitor:
        what = f"a {message.message_class}" if message else "not declared"
        text = f"'{name}' is {what}: only monitors can be fired"
        raise RequestError(Refusal.UNKNOWN if message is None else Refusal.PROTOCOL, text)
    return [watch for watch in central.watches.values() if watch.task.message is message]


def _check_fire(watch: Watch, wanted: str, body: bytes) -> None:
    """Raise RequestError if a monitor can't be fired with action *wanted* ("": any) and *body*."""
    task, action = watch.task, watch.parts[_ACTION]
    if task.message.message_class.has_condition:
        if not wanted:
            return
        text = f"{task} can't be fired with '{wanted}', for it tests its condition: fire it without"
        raise RequestError(Refusal.PROTOCOL, text)
    if not (wanted or body) and action is not None and action.format.data != NO_DATA:
        text = f"{task} can't be fired without data: its action is '{action.name}'"
        raise RequestError(Refusal.PROTOCOL, text)
    if wanted and (action is None or wanted != action.name):
        has = (
            f"its action is '{action.name}'"
            if action is not None
            else "it has no action: fire it without"
        )
        raise RequestError(Refusal.PROTOCOL, f"{task} can't be fired with '{wanted}': {has}")


def _requested_watch(central: State, task_id: TaskId) -> Watch | None:
    """Return the watch of a monitor; None if it has ended. Raise RequestError for other tasks."""
    task = central.tree.task(task_id)
    if task is not None and not task.message.message_class.is_monitor:
        raise RequestError(Refusal.PROTOCOL, f"{task} is not a monitor")
    return _watch_of(task) if task is not None else None


# --- the end --------------------------------------------------------------------------------------


def on_end_monitor(
    central: State, connection: Connection, header: headers.EndMonitor, _: bytes
) -> None:
    """End a monitor for a module, even one that does not watch yet."""
    watch = _requested_watch(central, header.monitor)
    if watch is None or watch.is_over:
        central.ignore(connection, header.number, f"monitor {{{header.monitor}}} has ended already")
        return
    end_monitor(central, watch, f"by module '{connection.module.name}'")
    central.accept(connection, header.number, header.monitor)


def on_duration_over(central: State, watch: Watch) -> None:
    """End a monitor that has watched for its full duration."""
    end_monitor(central, watch, f"it has watched for {watch.options.duration:g} s")


def end_background_monitors(central: State, task: Task) -> None:
    """End the background monitors of a task that has nothing else left under it."""
    for child in list((task.children or {}).values()) if task.has_only_background_left else ():
        is_to_begin = child.retry_pending or not child.reached & START_HANDLING
        if is_to_begin and (child.held or child.suspended):
            kill(central, child, Verdict(_ALL_ELSE))
        else:
            end_monitor(central, _watch_of(child), _ALL_ELSE)
