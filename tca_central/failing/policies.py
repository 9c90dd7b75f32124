"""Retry policies: which failures a task's policy deals with, and how.

Theory of operation. A policy acts like an exception handler of its task that is asked before those
of modules. While attempts are left, the task is retried after a pause: a delay that holds its next
handling. After the last attempt the *fallback* replaces the task: what a retry does is done, but
then central sends the fallback under the task as an exception handler that has resolved the
failure. If the fallback fails, the search for an exception handler continues.
"""

from collections.abc import Mapping
from types import MappingProxyType

from tca_central.errors import RequestError, check_name
from tca_central.failing.retry_order import check_order
from tca_central.model.budget import TIMER_BYTES
from tca_central.model.clock import checked_seconds
from tca_central.model.contexts import BY_POLICY, FailureContext, RaisedFailure, trouble_of
from tca_central.model.deliveries import AttachedHandler, MessageType
from tca_central.model.tasks import Policy, Recovery, Task
from tca_central.outgoing.central_messages import data_for, make_task
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.failures import UNCERTAIN
from tca_wire.messages.fitting import first_misfit
from tca_wire.messages.formats import NIL, NO_DATA
from tca_wire.packets.large import held_size
from tca_wire.packets.parts import MessageFormat, RetryPolicy
from tca_wire.points import START_HANDLING
from tca_wire.vocabulary import CENTRAL, LONGEST_TIME, Limit, MessageClass, Refusal, Role


def check_declared_policy(
    central: State, declared: MessageFormat, new: Mapping[str, MessageFormat]
) -> None:
    """Raise RequestError if a declared message can't have its retry policy.

    *new* has the messages that the same request declares.
    """
    if declared.retry is None:
        return
    if not _is_retried(declared.message_class):
        text = f"{declared.message_class} '{declared.name}' has no retry policy: declare a"
        raise RequestError(Refusal.FORMAT, f"{text} goal or command")
    check_policy(central, declared.retry, declared.name, new)


def check_policy(
    central: State,
    wanted: RetryPolicy,
    name: str = "",
    new: Mapping[str, MessageFormat] = MappingProxyType({}),
) -> None:
    """Raise RequestError if a retry policy is not possible.

    Args:
        central: The state.
        wanted: The policy.
        name: The message that declares it; "" if the sender of a task gives it.
        new: The messages that the same request declares, by name.
    """
    if not 1 <= wanted.attempts <= Limit.ATTEMPTS:
        text = (
            f"a retry policy with {wanted.attempts} attempts: 1 to {Limit.ATTEMPTS:d} are possible"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    for seconds in (wanted.pause, wanted.longest_pause, wanted.attempt_timeout):
        checked_seconds(seconds, "a retry policy with a time")
    if not 1 <= wanted.backoff <= LONGEST_TIME:
        text = f"a retry policy with a back-off of {wanted.backoff:g}: give a factor of 1 or more"
        raise RequestError(Refusal.PROTOCOL, text)
    for failure in wanted.failures:
        check_name("failure", failure)
    _check_fallbacks(central, wanted.fallback, name, new)
    check_policy_room(central)
    central.check_room(len(wanted.data))


def check_policy_room(central: State) -> None:
    """Raise RequestError if there is no room for the timers of another retry policy."""
    central.check_declared(2 * TIMER_BYTES)


def _check_fallbacks(
    central: State, fallback: str, name: str, new: Mapping[str, MessageFormat]
) -> None:
    """Raise RequestError unless a fallback and those of its own policy can be sent."""
    passed = {name}
    while fallback:
        known = central.registry.messages.get(fallback)
        declared = new.get(fallback) or (known.format if known is not None else None)
        if declared is None or not _is_retried(declared.message_class):
            what = f"of class {declared.message_class}" if declared else "not declared"
            text = f"a retry policy falls back on a goal or command, and '{fallback}' is {what}"
            raise RequestError(Refusal.UNKNOWN, text)
        if fallback in passed:
            text = f"'{fallback}' falls back on itself in the end: a retry policy must not"
            raise RequestError(Refusal.CYCLE, text)
        passed.add(fallback)
        fallback = declared.retry.fallback if declared.retry is not None else ""


def _is_retried(message_class: MessageClass) -> bool:
    """Whether tasks of a class can have a retry policy."""
    return message_class.is_task and message_class.may_react


def adopt(central: State, task: Task, wanted: RetryPolicy) -> None:
    """Give a new task its sender's retry policy, in place of the declared one."""
    Recovery.of(task).policy = Policy(task, wanted)
    central.tree.grow(task, len(wanted.data))


def _fallback_of(central: State, policy: Policy) -> MessageType | None:
    """Return the message that replaces a task after its last attempt; None without one."""
    return central.registry.messages.get(policy.declared.fallback)


def deals_with(central: State, task: Task, failing: Task, failure: RaisedFailure) -> bool:
    """Whether a task's policy deals with a failure of *failing*, which is the task or below it."""
    policy, names = Policy.of(task), {failure.name, *failure.kinds}
    if policy is None or task.killed or not task.reached & START_HANDLING:
        return False
    wanted = policy.declared.failures
    if (wanted and names.isdisjoint(wanted)) or (UNCERTAIN in names and UNCERTAIN not in wanted):
        return False
    if not (
        policy.has_attempts_left or task.retry_pending or _may_replace(central, policy, failing)
    ):
        return False
    try:
        check_order(central, task, None)
    except RequestError as error:
        central.facts.append(facts.RequestRefused(CENTRAL, error.refusal, error.text))
        return False
    return True


def _may_replace(central: State, policy: Policy, failing: Task) -> bool:
    """Whether the fallback may be sent: it has a handler, and has not failed itself."""
    fallback = _fallback_of(central, policy)
    return (
        fallback is not None
        and bool(fallback.handlers)
        and all(
            not trouble_of(one).is_fallback or trouble_of(one).failing is not policy.task
            for one in failing.exception_handlers_up()
        )
    )


def plan_next(central: State, task: Task, failing: Task, failure: RaisedFailure) -> facts.Retried:
    """Plan the next attempt of a task, or its fallback. Return the fact for the journal."""
    policy, pause = Policy.of(task), None
    assert policy is not None
    if not task.retry_pending and policy.has_attempts_left:
        pause = central.agenda.holds.pause(task, policy.pause)
    elif not task.retry_pending:
        fallback = _fallback_of(central, policy)
        assert fallback is not None
        text = failure.text if task is failing else f"in {failing}: {failure.text}"
        own = AttachedHandler(BY_POLICY, "", fallback, 1, task, CENTRAL)
        policy.replacement = FailureContext(task, failure._replace(text=text), task, own, {})
    replacement = policy.declared.fallback if policy.replacement is not None else ""
    return facts.Retried(task.id, b"", CENTRAL, failing.id, pause, replacement)


def end_attempt(central: State, task: Task, *, is_replaced: bool = False) -> None:
    """Stop the timer of a task's attempt: the task is retried or replaced, or has ended."""
    if (policy := Policy.of(task)) is not None:
        central.clock.cancel(policy.timer)
        policy.timer = None
        policy.replacement = policy.replacement if is_replaced else None


def send_fallback(central: State, task: Task) -> bool:
    """Send the fallback in place of a task's next attempt. Return whether it is due."""
    policy = Policy.of(task)
    if policy is None or policy.replacement is None:
        return False
    context, policy.replacement = policy.replacement, None
    assert isinstance(context, FailureContext)
    message = context.attached.handler
    name, text, data, _ = context.failure
    central.tree.set_failure(task, (name, text, data))
    body = policy.declared.data or data_for(message, task.body)
    fallback = make_task(central, message, body, task, Role.EXCEPTION, context=context)
    Recovery.of(task).exception_handler = fallback
    central.facts.append(facts.Caught(task.id, fallback.id, task.id, BY_POLICY))
    return True


def pass_result(central: State, task: Task, fallback: Task) -> bool:
    """Give a task the result of its fallback. Return False if the task wants another type."""
    own, wanted = fallback.message.format.reply, task.message.format.reply
    result = b"" if first_misfit(own, wanted) else fallback.result or NIL
    central.tree.grow(task, held_size(result) - held_size(task.result))
    task.result = result
    return bool(result) or first_misfit(NO_DATA, wanted) is None
