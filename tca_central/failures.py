"""Failures: raised on a task, handled by the nearest exception handler above, or the end of the top-level task.

Theory of operation (TCA paper, "Monitoring and Exception Handling"; TCM 2.10). The search starts at the failing task
and goes up to the root; on each task its own exception handlers come first, newest first, then those of its message.
The one that is found runs as a goal under the failing task. While it decides, the failing task does not count as
handled: if the handler returns the failure has been dealt with and what comes after goes on, or it retries the
failing task or one above, kills, adds, or reissues the failure, which lets the search go on above it.
"""

from collections.abc import Iterator

from tca_central import claims
from tca_central.errors import RequestError
from tca_central.intervals import KILLED, START_HANDLING
from tca_central.making import make_task, suspend
from tca_central.registry import Attached, Connection, MessageType
from tca_central.state import Failure, Recovery, State
from tca_central.taps import happened
from tca_central.taps import remove as remove_tap
from tca_central.task_tree import Task
from tca_central.watching import end_watch, stop
from tca_wire import facts, headers
from tca_wire.headers import Accepted, Cancelled
from tca_wire.parts import Attachment
from tca_wire.points import ALL_MOMENTS, ROOT, TaskId
from tca_wire.vocabulary import CENTRAL, Limit, MessageClass, Refusal, Role

LONGEST_TEXT = 16_384
"""Characters of a failure's text that are kept: the last, where a traceback says what happened."""

MOST_KINDS = 32
MOST_ATTACHED = 1000
"""Exception handlers of one task, or of one message."""

MOST_NESTED = 8
"""How deep in handlers that one attachment called it may be called once more: a handler that fails with the failure
that it handles would go on for ever."""


def failure_of(header: headers.Fail | headers.Raise, body: bytes) -> Failure:
    """The failure that a header tells of, within bounds."""
    kinds = tuple(kind[: Limit.NAME] for kind in header.kinds[:MOST_KINDS])
    return Failure(header.failure[: Limit.NAME], header.text[-LONGEST_TEXT:], body, kinds)


# --- attaching -------------------------------------------------------------------------------------------------------


def on_attach(central: State, connection: Connection, header: headers.Attach, _: bytes) -> None:
    """A module attaches an exception handler to a task, to all tasks of a message, or to the root."""
    message = None
    if header.message:
        message = _task_message(central, header.message)
    task = central.tree.root if header.task == ROOT else central.tree.task(header.task)
    if task is None:
        text = f"task {header.task} has ended: no exception handler can be attached to it"
        raise RequestError(Refusal.TOO_LATE, text)
    attached = attach(central, header.attachment, message or task, connection.module.called)
    central.send(connection, header.number, Accepted(header.number, attached.id))


def _task_message(central: State, name: str) -> MessageType:
    message = central.registry.messages.get(name)
    if message is None or not message.message_class.is_task:
        what = f"a {message.message_class}" if message else "not declared"
        text = f"'{name}' is {what}: exception handlers are attached to tasks, or to the messages that become tasks"
        raise RequestError(Refusal.UNKNOWN, text)
    return message


def check_attachments(central: State, wanted: list[Attachment]) -> None:
    """Raises RequestError if one of them can't be attached."""
    if len(wanted) > MOST_ATTACHED:
        raise RequestError(Refusal.OVERLOAD, f"{len(wanted)} exception handlers: {MOST_ATTACHED} are allowed")
    for attachment in wanted:
        handler = central.registry.messages.get(attachment.handler)
        if handler is None or handler.message_class is not MessageClass.EXCEPTION:
            what = f"a {handler.message_class}" if handler else "not declared"
            raise RequestError(Refusal.UNKNOWN, f"'{attachment.handler}' is {what}, and no exception handler")


def attach(central: State, wanted: Attachment, place: Task | MessageType, by: str) -> Attached:
    """Attach an exception handler as the newest; the same one of the same module, or of a copy, makes room for it."""
    check_attachments(central, [wanted])
    others = place.more.attached if isinstance(place, Task) else place.attached
    for other in others:
        if (other.failure, other.handler.name, other.by) == (wanted.failure, wanted.handler, by):
            _remove(central, other, by)
            break
    if len(others) >= MOST_ATTACHED:
        raise RequestError(Refusal.OVERLOAD, f"{place} has {MOST_ATTACHED} exception handlers already")
    handler = central.registry.messages[wanted.handler]
    attached = Attached(central.new_id(), wanted.failure, handler, max(0, wanted.maximum), place, by)
    others.append(attached)
    central.attached[attached.id] = attached
    task, message = (TaskId(place.id), "") if isinstance(place, Task) else (ROOT, place.name)
    central.facts.append(facts.Attached(attached.id, attached.failure, handler.name, task, message, attached.maximum))
    return attached


def on_remove(central: State, connection: Connection, header: headers.Remove, _: bytes) -> None:
    """A module takes an exception handler or a wiretap away, or an operator for all who want it; he ends monitors, too.
    One that is gone already is no error.
    """
    module, gone = connection.module, header.id
    if (attached := central.attached.get(header.id)) is not None:
        _remove(central, attached, module.name)
    elif (tap := central.taps.get(header.id)) is not None:
        remove_tap(central, tap, module, for_all=header.for_all)
    elif not 0 < header.id <= central.tree.newest:
        raise RequestError(Refusal.UNKNOWN, f"there is no exception handler or wiretap {header.id}")
    elif not (header.for_all and _end_monitor(central, header.id, module.name)):
        gone = 0
    central.send(connection, header.number, Accepted(header.number, gone))


def _end_monitor(central: State, number: int, by: str) -> bool:
    """End the monitor of that number; whether it still was to watch. Raises RequestError for a task that is none."""
    task = central.tree.tasks.get(number)
    if task is None:
        return False
    watch = task.rare.watch if task.rare is not None else None
    if watch is None:
        text = f"{task} is a {task.message.message_class}, which is not attached: kill it to end it"
        raise RequestError(Refusal.PROTOCOL, text)
    if watch.is_over:
        return False
    end_watch(central, watch, f"by module '{by}'")
    return True


def _remove(central: State, attached: Attached, by: str) -> None:
    place = attached.place
    (place.more.attached if isinstance(place, Task) else place.attached).remove(attached)
    del central.attached[attached.id]
    central.facts.append(facts.Removed(attached.id, by))


def forget_task(central: State, task: Task) -> None:
    """A task has ended, and what is attached to it is gone."""
    for attached in task.rare.attached if task.rare else ():
        del central.attached[attached.id]


# --- raising ---------------------------------------------------------------------------------------------------------


def on_raise(central: State, connection: Connection, header: headers.Raise, body: bytes) -> None:
    """A module raises a failure on a task that another one handles."""
    task = central.tree.task(header.task)
    if task is None or task.killed:
        ended = f"task {header.task} has ended" if task is None else f"{task} was killed"
        central.ignore(connection, header.number, f"{ended}: no failure can be raised on it")
        return
    raise_failure(central, task, failure_of(header, body))
    central.send(connection, header.number, Accepted(header.number))


def fail_task(central: State, task: Task, failure: Failure) -> None:
    """The handler of a task, which no handler has any more, ended with a failure."""
    central.facts.append(facts.Failed(task.id, failure.name, failure.text))
    if task.killed:
        central.agenda.returned(task)
    elif task.again:
        central.agenda.retry(task)
    else:
        handler = _search(central, task, failure)
        if handler is None:
            central.agenda.returned(task)
        else:
            task.more.recovering = handler


def raise_failure(central: State, task: Task, failure: Failure) -> None:
    """Raise a failure on a task beside its handler: who has the task goes on."""
    central.facts.append(facts.Failed(task.id, failure.name, failure.text, is_beside=True))
    _search(central, task, failure)


def _search(central: State, task: Task, failure: Failure, below: Recovery | None = None) -> Task | None:
    """Let the nearest exception handler take care of a failure, the nearest after *below* where one could not; its
    task. None if there is none: then the top-level task is killed, and whoever waits for it is told.
    """
    task.failure, task.is_dealt_with = (failure.name, failure.text, failure.body), False
    found = _find(central, task, failure, below)
    if found is None:
        _unhandled(central, task, failure)
        return None
    at, attached = found
    invocations = at.more.invocations
    invocations[attached.id] = invocations.get(attached.id, 0) + 1
    trouble = Recovery(task, failure, at, attached)
    handler = make_task(central, attached.handler, failure.body, task, Role.EXCEPTION, context=trouble)
    central.facts.append(facts.Caught(TaskId(task.id), TaskId(handler.id), TaskId(at.id), attached.id))
    return handler


def _find(central: State, task: Task, failure: Failure, below: Recovery | None) -> tuple[Task, Attached] | None:
    """The nearest exception handler that may be called, and the task that it holds for. One that nobody handles is
    passed over.
    """
    names = ("", failure.name, *failure.kinds)
    nested = _nested(task)
    for at, attached in _candidates(central, task, below):
        if attached.failure not in names or not attached.handler.handlers:
            continue
        calls = at.rare.invocations.get(attached.id, 0) if at.rare else 0
        is_exhausted = attached.maximum and calls >= attached.maximum
        if not is_exhausted and nested.get(attached.id, 0) < MOST_NESTED:
            return at, attached
    return None


def _candidates(central: State, task: Task, below: Recovery | None) -> Iterator[tuple[Task, Attached]]:
    """All exception handlers from *task* up, nearest first; only those after *below*, where a search goes on."""
    for at in (*task.lineage(), central.tree.root):
        own = at.rare.attached if at.rare else []
        if below is None:
            yield from ((at, attached) for group in (own, at.message.attached) for attached in reversed(group))
        elif at is below.at:
            yield from _rest(at, own, below.attached)
            below = None


def _rest(at: Task, own: list[Attached], after: Attached) -> Iterator[tuple[Task, Attached]]:
    """The exception handlers of one task that come after *after*, which may have been removed meanwhile."""
    is_own = isinstance(after.place, Task)
    for attached in reversed(own) if is_own else ():
        if attached.id < after.id:
            yield at, attached
    for attached in reversed(at.message.attached):
        if is_own or attached.id < after.id:
            yield at, attached


def _nested(task: Task) -> dict[int, int]:
    """For each attachment, how many of the tasks above are calls of it."""
    found: dict[int, int] = {}
    for above in task.lineage():
        if isinstance(above.context, Recovery):
            attachment = above.context.attached.id
            found[attachment] = found.get(attachment, 0) + 1
    return found


def _unhandled(central: State, task: Task, failure: Failure) -> None:
    central.facts.append(facts.Unhandled(TaskId(task.id)))
    top = task.top_level()
    exceptions = [above for above in task.lineage() if above.role is Role.EXCEPTION]
    is_of_its_handler = any(one.parent is top for one in exceptions)
    if top is not task and (top.failure is None or top.is_dealt_with or is_of_its_handler):
        text = f"in {task}: {failure.text}" if failure.text else f"in {task}"
        top.failure, top.is_dealt_with = (failure.name, text, failure.body), False
    why = f"failure '{failure.name}' of {task} was not handled"
    kill(central, top, why)
    for exception in reversed(exceptions):  # they survive what kills others, but not that they fail themselves
        kill(central, exception, why)


def kill(central: State, task: Task, why: str, by: str = CENTRAL) -> None:
    """End a task and all under it, as *by* wants. A handler that runs is never interrupted: it is told, and its task
    ends when it has returned. What was to be done on termination is done now; a killed exception handler has decided
    nothing.
    """
    killed = central.agenda.kill(task, why, by)
    new = {one.id for one in killed}
    for one in killed:
        happened(central, one, KILLED)
        if one.slot is not None:
            central.tell(one.slot, Cancelled(one.given_as))
        if one.suspended:
            one.suspended = False
            central.tree.suspended.pop(one.id, None)
            for child in list((one.children or {}).values()):
                if child.suspended and child.id not in new:  # it survives, or was killed before and has what survives
                    suspend(central, child, resume=True)
        if central.claimed_for:
            claims.killed(central, one)
        if one.rare is not None:
            _leave_behind(central, one, why, by)
        if one.role is Role.EXCEPTION and not one.more.is_void:
            one.more.is_void = True
            _search_on(central, one)


def _leave_behind(central: State, task: Task, why: str, by: str) -> None:
    """What else the kill of a task brings about."""
    assert task.rare is not None
    if task.reached & START_HANDLING:
        for message, body in task.rare.parting:
            make_task(central, message, body, task, Role.TERMINATION)
    if task.rare.watch is not None:
        stop(central, task.rare.watch, "it was killed")
    for listener in task.rare.listeners:
        if listener.reached != ALL_MOMENTS:
            kill(central, listener, why, by)


# --- what an exception handler decides -------------------------------------------------------------------------------


def reissue(central: State, handler: Task) -> None:
    """The handler cannot deal with the failure: the search goes on after it."""
    central.facts.append(facts.Reissued(TaskId(handler.id)))
    handler.more.is_void = True
    _search_on(central, handler)
    central.agenda.returned(handler)


def _search_on(central: State, handler: Task) -> None:
    trouble: Recovery = handler.context
    failing = trouble.failing
    if failing.killed or failing.again:
        return
    is_deciding = failing.more.recovering is handler
    following = _search(central, failing, trouble.failure, trouble)
    if is_deciding:
        failing.more.recovering = following
        if following is None:
            central.agenda.returned(failing)


def handler_ended(central: State, handler: Task) -> None:
    """An exception handler, with all that it made, has ended: if it decided nothing else the failure has been dealt
    with.
    """
    failing: Task = handler.context.failing
    if handler.more.is_void:
        return
    is_deciding = failing.more.recovering is handler
    if is_deciding:
        failing.more.recovering = None
    if failing.killed or failing.again:
        return
    failing.is_dealt_with = True
    central.facts.append(facts.Recovered(TaskId(failing.id)))
    if is_deciding:
        central.agenda.returned(failing)


def _check_retry(connection: Connection, task: Task) -> None:
    """Raises RequestError if an exception handler wants to retry what is not on the way from the failing task up: one
    that retried itself would go on for ever.
    """
    asking = next(reversed(connection.handling), None)
    if asking is not None and isinstance(asking.context, Recovery):
        failing = asking.context.failing
        if all(above is not task for above in failing.lineage()):
            text = f"{asking} handles the failure of {failing}: it can retry that or a task above it, and not {task}"
            raise RequestError(Refusal.PROTOCOL, text)


def on_retry(central: State, connection: Connection, header: headers.Retry, body: bytes) -> None:
    """A task is to be handled again, when all under it, and the exception handler that asks for it, has ended."""
    task = central.tree.task(header.task)
    if task is None or task.killed:
        ended = f"task {header.task} has ended" if task is None else f"{task} was killed"
        central.ignore(connection, header.number, f"{ended}: it can't be retried")
        return
    _check_retry(connection, task)
    if task.rare is not None and task.rare.watch is not None:
        stop(central, task.rare.watch, "it is retried")
    if header.new_data:
        task.body = body
    task.failure = None
    by = connection.module.name
    central.facts.append(facts.Retried(TaskId(task.id), body if header.new_data else b"", by))
    if task.reached & START_HANDLING:
        why = f"{task} is retried"
        for child in list((task.children or {}).values()):
            if not child.survives:
                kill(central, child, why, by)
        if task.slot is not None:
            central.tell(task.slot, Cancelled(task.given_as))
        central.agenda.retry(task)
    else:
        central.agenda.begin_anew(task)
    central.send(connection, header.number, Accepted(header.number, task.id))
