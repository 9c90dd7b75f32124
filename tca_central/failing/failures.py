"""Failures: raised on a task, and handled by the nearest exception handler above.

Theory of operation (TCA paper, "Monitoring and Exception Handling"; TCM 2.10). A search starts at
the failing task and goes up to the root. On each task it tries the task's own exception handlers,
newest first, then those of the task's message. The handler found runs as a goal under the failing
task. While the handler decides, the failing task does not count as handled. If no handler is found,
the failure ends the top-level task.

Three decisions deal with a failure: a retry of the failing task or of a task above it, a kill of
such a task, and ``resolved()``. ``resolved()`` takes effect when the handler's task has ended. In
all other cases the search continues above the handler. It continues at once when the handler
reissues the failure. It also continues at once when the handler itself fails with a failure in
``NOT_BY_CHOICE``, such as "timeout", and no exception handler deals with that failure. Any other
failure of the handler itself that remains unhandled is a decision, too: the top-level task ends.
Otherwise the search continues when the handler's task has ended.
"""

from collections import Counter
from collections.abc import Iterator
from math import inf

from tca_central.errors import RequestError
from tca_central.failing.policies import deals_with, end_attempt, pass_result, plan_next
from tca_central.failing.retry_order import check_order
from tca_central.locks import claims
from tca_central.model.contexts import (
    BY_POLICY,
    Decision,
    FailureContext,
    RaisedFailure,
    trouble_of,
)
from tca_central.model.deliveries import AttachedHandler, Connection, Delivery
from tca_central.model.tasks import Recovery, Task, Verdict
from tca_central.outgoing.central_messages import make_task, suspend
from tca_central.state import State
from tca_central.watching.taps import fire_after
from tca_central.watching.watches import stop_watching
from tca_wire.journal import facts
from tca_wire.messages.failures import NOT_BY_CHOICE
from tca_wire.messages.formats import NIL
from tca_wire.packets import headers
from tca_wire.packets.large import held_size
from tca_wire.points import (
    ALL_MOMENTS,
    ROOT,
    START_HANDLING,
)
from tca_wire.rules import KILLED
from tca_wire.text.printable import printable, shortened
from tca_wire.vocabulary import CENTRAL, Limit, Refusal, Role

LONGEST_REASON = 500
"""The number of characters, in a failure's text, of the reason why a handler could not decide."""

MOST_ATTEMPTS = 100
"""Handlings of a task after which exception handlers without a maximum can't retry the task."""
MOST_KINDS = 32
"""The number of more general failures that one failure may name. Further names are ignored."""
MOST_NESTED = 8
"""The number of calls of an exception handler within each other.

A handler may fail with the failure that it handles. Then it is called again for its own failure.
"""

NEWLINE = "\n"  # no backslash may stand in an f-string's braces


def failure_of(header: headers.Fail | headers.Raise, body: bytes) -> RaisedFailure:
    """Return the failure that a header reports, with its parts shortened to their limits."""
    failure, *kinds = (
        printable(name)[: Limit.NAME] for name in (header.failure, *header.kinds[:MOST_KINDS])
    )
    return RaisedFailure(failure, shortened(header.text), body, tuple(kinds))


# --- raising --------------------------------------------------------------------------------------


def on_raise(central: State, connection: Connection, header: headers.Raise, body: bytes) -> None:
    """Raise a module's failure on a task that another module handles."""
    task = central.living_task_or_ignore(
        connection, header.number, header.task, "no failure can be raised on it"
    )
    if task is not None:
        central.check_room(held_size(body))
        raise_failure(central, task, failure_of(header, body), connection.module.name)
        central.accept(connection, header.number, header.task)


def fail_task(central: State, task: Task, failure: RaisedFailure) -> None:
    """Handle the failure with which a task's handler has ended."""
    central.record_failure(task, failure)
    if central.agenda.end_or_retry(task):
        return
    _set_decider(central, task, _search(central, task, failure, from_outside=False))


def _set_decider(central: State, task: Task, found: Task | None) -> None:
    """Have a failed task wait for the exception handler that was found, if one was.

    Otherwise the task counts as returned, unless its own retry policy retries it.
    """
    if found is not None and found.role is Role.EXCEPTION and found.parent is task:
        Recovery.of(task).exception_handler = found
    elif not task.retry_pending:
        central.agenda.mark_returned(task)


def raise_failure(central: State, task: Task, failure: RaisedFailure, by: str = CENTRAL) -> None:
    """Raise a failure on a task from outside its handler, which continues."""
    if task.returned and task.failure is None and not task.result:
        central.tree.grow(task, len(NIL))
        task.result = NIL  # the handler's None: the task's result if this failure is resolved
    central.record_failure(task, failure, from_outside=True, by=by)
    _search(central, task, failure, from_outside=True)


def _search(
    central: State, task: Task, failure: RaisedFailure, *, from_outside: bool
) -> Task | None:
    """Call the nearest exception handler for a failure. Return its task.

    If a retry policy is nearer, return the task that the policy retries. Without either, the
    top-level task ends, its sender gets the failure, and this returns None.
    """
    found = _call_handler(central, task, failure, from_outside=from_outside)
    if found is None:
        _continue_search(central, _end_unhandled(central, task, failure))
    return found


def _continue_search(central: State, exception_handler: Task | None) -> None:
    """Continue a search above an exception handler that could not decide, if one is given.

    If no handler is left above it, the failing task may itself be part of an exception handler.
    Then the search continues above that handler.
    """
    while exception_handler is not None:
        trouble = trouble_of(exception_handler)
        failing, recovery = trouble.failing, Recovery.of(trouble.failing)
        if failing.killed:
            return
        is_deciding = recovery.exception_handler is exception_handler
        found = _call_handler(
            central, failing, trouble.failure, trouble, from_outside=not is_deciding
        )
        if is_deciding:
            recovery.exception_handler = None
            _set_decider(central, failing, found)
        exception_handler = (
            _end_unhandled(central, failing, trouble.failure) if found is None else None
        )


def _call_handler(
    central: State,
    task: Task,
    failure: RaisedFailure,
    previous: FailureContext | None = None,
    *,
    from_outside: bool,
) -> Task | None:
    """Call the nearest exception handler for a failure. Return its task; None if there is none.

    If a retry policy is nearer, apply it, and return its task.

    *previous* is the context of a handler that could not decide. Then the search continues above
    that handler.
    """
    central.tree.set_failure(task, (failure.name, failure.text, failure.body))
    handlers_above = task.exception_handlers_up()
    passed: dict[tuple[int, str], None] = {}
    if handlers_above:
        passed = trouble_of(handlers_above[0]).passed
    elif previous is not None:
        passed = previous.passed
    nested = Counter(trouble_of(one).attached.id for one in handlers_above)
    trouble = _find_handler(central, task, failure, previous, passed, nested)
    if trouble is None:
        return None
    if isinstance(trouble, Task):
        _follow_policy(central, trouble, task, failure)
        return trouble
    at, attached = trouble.at, trouble.attached
    _count_call(central, at, attached)
    exception_handler = make_task(
        central, attached.handler, failure.body, task, Role.EXCEPTION, context=trouble
    )
    central.facts.append(
        facts.Caught(task.id, exception_handler.id, at.id, attached.id, from_outside)
    )
    return exception_handler


def _follow_policy(central: State, task: Task, failing: Task, failure: RaisedFailure) -> None:
    """Retry or replace a task as its retry policy says, for a failure of it or below it."""
    exception_handlers = failing.exception_handlers_up()
    fact = plan_next(central, task, failing, failure)
    retry_task(central, task, None, CENTRAL, by_policy=fact)
    for one in reversed(exception_handlers):  # they survive the kill of the tasks between
        if one.depth > task.depth:
            kill(central, one, Verdict(f"{task} is retried"))


def _count_call(central: State, at: Task, attached: AttachedHandler) -> None:
    """Count a call. Forget the counts of removed exception handlers when most counts are such."""
    recovery = Recovery.of(at)
    calls = recovery.invocations
    calls[attached.id] = calls.get(attached.id, 0) + 1
    if len(calls) > 2 * (len(at.attached) + len(at.message.attached)) + 16:
        recovery.invocations = {
            number: count for number, count in calls.items() if number in central.attached
        }


def _find_handler(
    central: State,
    task: Task,
    failure: RaisedFailure,
    previous: FailureContext | None,
    passed: dict[tuple[int, str], None],
    nested: Counter[int],
) -> FailureContext | Task | None:
    """Return the context of the nearest exception handler that may be called.

    If a retry policy that deals with the failure is nearer, return its task. *passed* contains the
    handlers that could not decide. *nested* counts the calls of each exception handler that the
    task is part of.
    """
    names = ("", failure.name, *failure.kinds)
    for at, attached in _candidates(task, previous):
        if attached is None:
            if deals_with(central, at, task, failure):
                return at
            continue
        if attached.failure not in names or not attached.handler.handlers:
            continue
        if (attached.id, failure.name) in passed:
            continue
        if (
            (attached.id, "") in passed
            and task.role is Role.EXCEPTION
            and trouble_of(task).attached is attached
        ):
            continue  # the handler's own retry was refused
        calls = at.recovery.invocations.get(attached.id, 0) if at.recovery is not None else 0
        is_exhausted = attached.maximum and calls >= attached.maximum
        if not is_exhausted and nested[attached.id] < MOST_NESTED:
            return FailureContext(task, failure, at, attached, passed)
    return None


def _candidates(
    task: Task, previous: FailureContext | None
) -> Iterator[tuple[Task, AttachedHandler | None]]:
    """Yield the exception handlers of a task and its ancestors, nearest first, with their tasks.

    None stands for a task's retry policy, which comes before its exception handlers. With
    *previous*, yield only the handlers after the handler of that context.
    """
    above: Task | None = task if previous is None else previous.at
    # The walk takes 0.1 ms at a depth of 1,000 tasks, and 10 ms at the greatest depth, 20,000.
    while above is not None:
        at, above = above, above.parent
        own = at.recovery.attached if at.recovery is not None else ()
        is_resumed = previous is not None and at is previous.at
        if at.recovery is not None and at.recovery.policy is not None and not is_resumed:
            yield at, None
        if not (own or at.message.attached):
            continue
        found = [*reversed(own), *reversed(at.message.attached)]
        if is_resumed and previous is not None:  # that handler may be removed by now
            found = [one for one in found if _rank(one) > _rank(previous.attached)]
        yield from ((at, one) for one in found)


def _rank(attached: AttachedHandler) -> tuple[bool, float]:
    """Return the sort key of a task's handlers: its policy, then its own, the newest first."""
    if attached.id == BY_POLICY:
        return False, -inf
    return not isinstance(attached.place, Task), -attached.id


def _end_unhandled(central: State, task: Task, failure: RaisedFailure) -> Task | None:
    """End the top-level task of a failure that no handler deals with, and return None.

    If the failing task is part of an exception handler that could not decide, kill that handler
    instead. Return the handler if the search must continue above it. A handler that fails by choice
    has decided to end the top-level task; a fallback has not. The search continues nevertheless if
    another exception handler has asked for a retry of a task above.
    """
    handlers_above = task.exception_handlers_up()
    undecided = handlers_above[0] if handlers_above else None
    is_fallback = undecided is not None and trouble_of(undecided).is_fallback
    by_choice = NOT_BY_CHOICE.isdisjoint((failure.name, *failure.kinds)) and not is_fallback
    if undecided is not None and by_choice:
        above = trouble_of(undecided).failing.lineage()
        undecided = (
            undecided if any(_is_retried_by_another(one, handlers_above) for one in above) else None
        )
    central.facts.append(facts.Unhandled(task.id, undecided.id if undecided else ROOT))
    verdict = Verdict(f"failure '{failure.name}' of {task} was not handled", failed=task.id)
    if undecided is None:
        _end_top_level(central, task, failure, verdict)
        return None
    trouble = trouble_of(undecided)
    was_in_force = _void_decision(undecided)
    kill(central, undecided, verdict)
    if not was_in_force:
        return None
    trouble.passed[trouble.attached.id, trouble.failure.name] = None
    where = f" in {task}" if task is not undecided else ""
    reason = f"{failure.name}{where}: {failure.text.partition(NEWLINE)[0]}".removesuffix(": ")
    trouble.failure = _with_undecided(
        trouble.failure, undecided, f"could not decide: {reason[:LONGEST_REASON]}"
    )
    return undecided


def _is_retried_by_another(above: Task, handlers_above: list[Task]) -> bool:
    """Whether *above* is about to be retried, at the request of none of *handlers_above*."""
    retry_requesters = above.recovery.retry_requesters if above.recovery is not None else {}
    return above.retry_pending and retry_requesters.keys().isdisjoint(handlers_above)


def _with_undecided(first: RaisedFailure, undecided: Task, what: str) -> RaisedFailure:
    """Return the failure *first*. The first line of its text adds *what* the handler did."""
    line, newline, rest = first.text.partition(NEWLINE)
    line = shortened(line, Limit.TEXT // 2)
    summary = f"{line}; exception handler {undecided} {what}".removeprefix("; ")
    return first._replace(text=shortened(f"{summary}{newline}{rest}"))


def _end_top_level(central: State, task: Task, failure: RaisedFailure, verdict: Verdict) -> None:
    """End the top-level task, and report the failure to its sender."""
    *_, top = task.lineage()
    handlers_above = task.exception_handlers_up()
    is_under_its_handler = any(one.parent is top for one in handlers_above)
    if top is not task and (top.failure is None or top.is_dealt_with or is_under_its_handler):
        text = f"in {task}: {failure.text}" if failure.text else f"in {task}"
        central.tree.set_failure(top, (failure.name, text, failure.body))
    kill(central, top, verdict)
    # Exception handlers survive the kill of the tasks above, but not their own failure.
    for exception_handler in reversed(handlers_above):
        kill(central, exception_handler, verdict)


def kill(central: State, task: Task, verdict: Verdict) -> None:
    """Kill a task and all tasks under it.

    A task whose handler is running ends when the handler has returned.
    """
    killed = central.agenda.kill(task, verdict)
    new = {victim.id for victim in killed}
    for victim in killed:  # claims end before anything is sent
        if victim.slot is not None:
            central.cancel(victim.slot, victim)
        if central.claimed_for:
            claims.end_claims_of_killed(central, victim)
    for victim in killed:
        fire_after(central, victim, KILLED)
        if victim.suspended:
            victim.suspended = False
            central.tree.suspended.pop(victim.id, None)
            for child in list((victim.children or {}).values()):
                # The child survives the kill, or was killed before with a surviving descendant.
                if child.suspended and child.id not in new:
                    suspend(central, child, resume=True)
        _after_kill(central, victim, verdict)
        if victim.role is Role.EXCEPTION and _void_decision(victim):
            _continue_search(central, victim)


def _void_decision(exception_handler: Task) -> bool:
    """Void an exception handler's decision. Return False if the decision was void already."""
    trouble = trouble_of(exception_handler)
    was_in_force, trouble.decision = trouble.decision is not Decision.VOID, Decision.VOID
    return was_in_force


def _after_kill(central: State, task: Task, verdict: Verdict) -> None:
    """Send a started task's termination messages. End the task's watch, and kill its listeners."""
    if task.scheduled is not None and task.reached & START_HANDLING:
        for message, body in task.scheduled.termination_messages:
            make_task(central, message, body, task, Role.TERMINATION)
    if task.watch is not None:
        stop_watching(central, task.watch, "it was killed")
    fallback = task.recovery.exception_handler if task.recovery is not None else None
    if (
        fallback is not None
        and fallback.reached != ALL_MOMENTS
        and trouble_of(fallback).is_fallback
    ):
        kill(central, fallback, verdict)
    for listener in task.tapping.listeners if task.tapping is not None else ():
        if listener.reached != ALL_MOMENTS:
            kill(central, listener, verdict)


def skip_exception_handler(central: State, exception_handler: Delivery) -> None:
    """Continue the search after an exception handler whose message no module handles."""
    assert isinstance(exception_handler, Task)
    if exception_handler.killed or exception_handler.queues != ():  # killed, or it has a handler
        return
    why = f"no module handles '{exception_handler.message.name}' any more"
    trouble = trouble_of(exception_handler)
    trouble.failure = _with_undecided(
        trouble.failure, exception_handler, f"could not decide: {why}"
    )
    kill(central, exception_handler, Verdict(why))


# --- decisions of exception handlers --------------------------------------------------------------


def reissue(central: State, exception_handler: Task) -> None:
    """Continue the search after an exception handler that can't deal with the failure."""
    central.facts.append(facts.Reissued(exception_handler.id))
    if _void_decision(exception_handler):
        _continue_search(central, exception_handler)
    central.agenda.mark_returned(exception_handler)


def on_resolve(central: State, connection: Connection, header: headers.Resolve, _: bytes) -> None:
    """Record that an exception handler has dealt with its failure.

    The decision takes effect when the handler's task has ended. After a retry or kill, the decision
    has no effect.
    """
    asking = central.dispatcher.running.get(central.origin)
    if asking is None:
        text = "the exception handler has returned: call resolved() before that"
        raise RequestError(Refusal.TOO_LATE, text)
    if not isinstance(asking, Task) or asking.role is not Role.EXCEPTION:
        text = f"message {asking.message_id} handles no failure: only exception handlers resolve"
        raise RequestError(Refusal.PROTOCOL, text)
    trouble = trouble_of(asking)
    is_over = trouble.decision is Decision.VOID or trouble.failing.killed
    has_effect = not (is_over or asking.retry_pending or asking.killed)
    if has_effect and trouble.decision is Decision.NONE:
        trouble.decision = Decision.DEALT_WITH
        central.facts.append(facts.Resolved(asking.id))
    central.accept(connection, header.number, asking.id if has_effect else ROOT)


def on_exception_handler_ended(central: State, exception_handler: Task) -> None:
    """Apply the decision of an exception handler whose task has ended, or continue the search."""
    trouble = trouble_of(exception_handler)
    failing = trouble.failing
    for asked in trouble.retried:
        central.agenda.end_retry_request(asked, exception_handler)
    if not failing.killed:
        if trouble.decision is Decision.DEALT_WITH:
            _recover(central, failing, exception_handler)
        elif trouble.decision is Decision.NONE:
            _continue_unresolved(central, failing, exception_handler)
    central.agenda.mark_decision_processed(failing)


def _recover(central: State, failing: Task, exception_handler: Task) -> None:
    """Mark a task's failure as dealt with. The task continues if it waited for this handler."""
    recovery = Recovery.of(failing)
    trouble = trouble_of(exception_handler)
    if trouble.is_fallback and not pass_result(central, failing, exception_handler):
        what = "replaced it as its fallback, without a result of its type"
        failure = _with_undecided(trouble.failure, exception_handler, what)
        central.tree.set_failure(failing, (failure.name, failure.text, failure.body))
    recovery.is_dealt_with = True
    central.facts.append(facts.Recovered(failing.id, exception_handler.id))
    if recovery.exception_handler is exception_handler:
        recovery.exception_handler = None
        central.agenda.mark_returned(failing)


def _continue_unresolved(central: State, failing: Task, exception_handler: Task) -> None:
    """Continue the search, and add to the failure's text why the handler has changed nothing."""
    central.facts.append(facts.NotResolved(exception_handler.id, failing.id))
    trouble = trouble_of(exception_handler)
    trouble.failure = _with_undecided(
        trouble.failure, exception_handler, "returned without dealing with it"
    )
    _continue_search(central, exception_handler)


def _asking_handler(central: State, task: Task) -> Task | None:
    """Return the exception handler that asks for a retry; None if no exception handler asks.

    Raises RequestError if the exception handler may not retry *task*.
    """
    asking = central.dispatcher.running.get(central.origin)
    if not isinstance(asking, Task) or not isinstance(asking.context, FailureContext):
        return None
    failing = asking.context.failing
    if failing.find_above(task.id) is None:
        text = (
            f"{asking} handles the failure of {failing}: "
            f"it can retry that task or one above it, not {task}"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    return asking


def _check_attempts(task: Task, asking: Task) -> None:
    """Raise RequestError if the task was handled so often that a retry needs a maximum."""
    attempts = task.recovery.attempts if task.recovery is not None else 1
    trouble = trouble_of(asking)
    if not trouble.attached.maximum and attempts >= MOST_ATTEMPTS:
        text = f"{task} was handled {attempts} times: attach its exception handler with maximum="
        # The refusal makes the handler fail. It must not be called for this failure of its own.
        trouble.passed[trouble.attached.id, ""] = None
        raise RequestError(Refusal.OVERLOAD, text)


def _void_earlier_decisions(task: Task) -> None:
    """Void the decisions of exception handlers about a retried task's earlier failures."""
    for child in (task.children or {}).values():
        if child.role is Role.EXCEPTION:
            trouble_of(child).decision = Decision.VOID


def _kill_descendants(central: State, task: Task, verdict: Verdict) -> None:
    """Kill the tasks under a retried task, except foreign monitors and tasks that survive kills."""
    for child in list((task.children or {}).values()):
        if not (child.role.survives or child.is_foreign_monitor):
            kill(central, child, verdict)


def on_retry(central: State, connection: Connection, header: headers.Retry, body: bytes) -> None:
    """Retry a task once the tasks under it, and the exception handler that asks, have ended."""
    task = central.living_task_or_ignore(
        connection, header.number, header.task, "it can't be retried"
    )
    if task is None:
        return
    asking = _asking_handler(central, task)
    if asking is not None:
        _check_attempts(task, asking)
    check_order(central, task, asking)
    if header.new_data:
        central.check_room(held_size(body))
    retry_task(central, task, body if header.new_data else None, connection.module.name, asking)
    central.accept(connection, header.number, task.id)


def _set_decision(trouble: FailureContext, decision: Decision) -> None:
    """Set an exception handler's decision, unless the decision is void."""
    if trouble.decision is not Decision.VOID:
        trouble.decision = decision


def retry_task(
    central: State,
    task: Task,
    data: bytes | None,
    by: str,
    asking: Task | None = None,
    by_policy: facts.Retried | None = None,
) -> None:
    """Have a task handled again, with new *data* if given. ``check_order`` must have passed.

    If its retry policy wants that, *by_policy* is the fact for the journal.
    """
    end_attempt(central, task, is_replaced=by_policy is not None and bool(by_policy.fallback))
    has_begun = bool(task.reached & START_HANDLING)
    if has_begun and task.watch is not None:
        stop_watching(central, task.watch, "it is retried")
    if data is not None:
        central.tree.grow(task, held_size(data) - held_size(task.body))
        task.body = data
    central.tree.set_failure(task, None)
    central.facts.append(by_policy or facts.Retried(task.id, data or b"", by))
    if task.role is Role.EXCEPTION:
        _set_decision(trouble_of(task), trouble_of(task).initial_decision)
    if asking is not None:
        _set_decision(trouble_of(asking), Decision.DEALT_WITH)
    _void_earlier_decisions(task)
    if has_begun:
        _kill_descendants(central, task, Verdict(f"{task} is retried", by, central.origin))
        if asking is not None and asking not in Recovery.of(task).retry_requesters:
            Recovery.of(task).retry_requesters[asking] = None
            trouble_of(asking).retried.append(task)
            central.tree.crossing_leaders[asking] = None
        if task.slot is not None:
            central.cancel(task.slot, task)
        central.agenda.retry(task)
    else:
        central.agenda.fire_taps_again(task)
