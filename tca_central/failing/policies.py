"""Retry policies: which failures a task's policy deals with, and how.

Theory of operation. A policy acts like an exception handler of its task that is asked before those
of modules. While attempts are left, the task is retried after a pause: a delay that holds its next
handling. After the last attempt the *fallback* replaces the task: what a retry does is done, but
then central sends the fallback under the task as an exception handler that has resolved the
failure. If the fallback fails, the search for an exception handler continues.
"""

from tca_central.errors import RequestError, check_name
from tca_central.failing.retry_order import check_order
from tca_central.model.budget import TIMER_BYTES
from tca_central.model.clock import checked_seconds
from tca_central.model.contexts import Decision, FailureContext, RaisedFailure, trouble_of
from tca_central.model.deliveries import AttachedHandler, MessageType
from tca_central.model.tasks import Policy, Recovery, Task
from tca_central.outgoing.central_messages import data_for, make_task
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.failures import UNCERTAIN
from tca_wire.messages.fitting import first_misfit
from tca_wire.messages.formats import NIL, NO_DATA
from tca_wire.packets.parts import RetryPolicy
from tca_wire.points import START_HANDLING
from tca_wire.vocabulary import CENTRAL, LONGEST_TIME, Limit, Refusal, Role

BY_POLICY = 0
"""The number that stands for a policy where attachments have theirs."""


def check_policy(central: State, wanted: RetryPolicy) -> None:
    """Raise RequestError if a retry policy is not possible."""
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
    _fallback_of(central, wanted)
    central.check_declared(2 * TIMER_BYTES)
    central.check_room(len(wanted.data))


def _fallback_of(central: State, wanted: RetryPolicy) -> MessageType | None:
    """Return the message of a policy's fallback. Raises RequestError if no task can be sent."""
    if not wanted.fallback:
        return None
    message = central.registry.messages.get(wanted.fallback)
    if message is None or not (message.message_class.is_task and message.message_class.may_react):
        what = f"{message.title} is no" if message else f"'{wanted.fallback}' is not a declared"
        text = f"a retry policy falls back on a goal or command, and {what} such message"
        raise RequestError(Refusal.UNKNOWN, text)
    return message


def adopt(central: State, task: Task, wanted: RetryPolicy) -> None:
    """Give a new task its retry policy."""
    Recovery.of(task).policy = Policy(task, wanted, _fallback_of(central, wanted))
    central.tree.grow(task, len(wanted.data))


def deals_with(central: State, task: Task, failing: Task, failure: RaisedFailure) -> bool:
    """Whether a task's policy deals with a failure of *failing*, which is the task or below it."""
    policy, names = Policy.of(task), {failure.name, *failure.kinds}
    if policy is None or task.killed or not task.reached & START_HANDLING:
        return False
    wanted = policy.declared.failures
    if (wanted and names.isdisjoint(wanted)) or (UNCERTAIN in names and UNCERTAIN not in wanted):
        return False
    if not (policy.has_attempts_left or task.retry_pending or _may_replace(policy, failing)):
        return False
    try:
        check_order(central, task, None)
    except RequestError as error:
        central.facts.append(facts.RequestRefused(CENTRAL, error.refusal, error.text))
        return False
    return True


def _may_replace(policy: Policy, failing: Task) -> bool:
    """Whether the fallback may be sent: it has a handler, and has not failed itself."""
    return (
        policy.fallback is not None
        and bool(policy.fallback.handlers)
        and all(
            trouble_of(one).attached.id != BY_POLICY or trouble_of(one).failing is not policy.task
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
        assert policy.fallback is not None
        text = failure.text if task is failing else f"in {failing}: {failure.text}"
        own = AttachedHandler(BY_POLICY, "", policy.fallback, 1, task, CENTRAL)
        policy.replacement = FailureContext(task, failure._replace(text=text), task, own, {})
        policy.replacement.decision = Decision.DEALT_WITH
    fallback = policy.fallback.name if policy.replacement and policy.fallback else ""
    return facts.Retried(task.id, b"", CENTRAL, failing.id, pause, fallback)


def end_attempt(central: State, task: Task, *, is_replaced: bool = False) -> None:
    """Stop the timer of a task's attempt: the task is retried or replaced, or has ended."""
    if (policy := Policy.of(task)) is not None:
        central.clock.cancel(policy.timer)
        policy.timer = None
        policy.replacement = policy.replacement if is_replaced else None


def send_fallback(central: State, task: Task) -> bool:
    """Send the fallback in place of a task's next attempt. Return whether it is due."""
    policy = Policy.of(task)
    if policy is None or policy.replacement is None or policy.fallback is None:
        return False
    context, policy.replacement = policy.replacement, None
    assert isinstance(context, FailureContext)
    name, text, data, _ = context.failure
    central.tree.set_failure(task, (name, text, data))
    body = policy.declared.data or data_for(policy.fallback, task.body)
    fallback = make_task(central, policy.fallback, body, task, Role.EXCEPTION, context=context)
    Recovery.of(task).exception_handler = fallback
    central.facts.append(facts.Caught(task.id, fallback.id, task.id, BY_POLICY))
    return True


def pass_result(central: State, task: Task, fallback: Task) -> bool:
    """Give a task the result of its fallback. Return False if the task wants another type."""
    own, wanted = fallback.message.format.reply, task.message.format.reply
    result = b"" if first_misfit(own, wanted) else fallback.result or NIL
    central.tree.grow(task, len(result) - len(task.result))
    task.result = result
    return bool(result) or first_misfit(NO_DATA, wanted) is None
