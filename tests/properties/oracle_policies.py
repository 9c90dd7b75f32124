"""The rules of retry policies.

A policy is asked before the exception handlers of its task. While attempts are left, it has the
task handled again after a pause. After the last attempt its fallback replaces the task: central
sends the fallback in place of the next handling, as an exception handler that has resolved the
failure.
"""

from dataclasses import dataclass

from properties import oracle_failures, oracle_rules
from properties.oracle_records import SH, Attachment, Node, Trouble, World

from tca_wire.packets.parts import RetryPolicy
from tca_wire.vocabulary import Role

LAST_RESORT = float("inf")
"""The number of the attachment that stands for a policy: it comes before all others of its task."""


@dataclass(eq=False)
class Policy:
    """The retry policy of a task at work."""

    declared: RetryPolicy
    attempts: int = 1  # handlings so far, with the present one
    is_late: bool = False  # the task has missed a deadline: no attempt is left
    replaced: tuple[str, ...] = ()  # the failure for which the fallback is to be sent

    @property
    def has_attempts_left(self) -> bool:
        return not self.is_late and self.attempts < self.declared.attempts


def deals_with(world: World, node: Node, failing: Node, names: tuple[str, ...]) -> bool:
    """Whether the policy of a task deals with a failure of *failing*, the task or one below it."""
    policy = node.policy
    if policy is None or node.killed or SH not in node.past:
        return False
    wanted = set(policy.declared.failures)
    if (wanted or "uncertain" in names) and not wanted & set(names):
        return False
    if not (policy.has_attempts_left or node.again or _may_replace(world, node, failing)):
        return False
    return not world.seen.take_refused_retry(node.id)


def _may_replace(world: World, node: Node, failing: Node) -> bool:
    """Whether the fallback has a handler, and is not itself what fails."""
    assert node.policy is not None
    return bool(world.handlers.get(node.policy.declared.fallback)) and not any(
        is_fallback(above) and above.parent is node for above in failing.lineage()
    )


def is_fallback(handler: Node) -> bool:
    return handler.failing is not None and handler.failing.attachment.id == LAST_RESORT


def apply(world: World, node: Node, failing: Node, names: tuple[str, ...]) -> None:
    """Retry a task, or plan its replacement. All below it ends, exception handlers included."""
    policy, handlers = node.policy, failing.lineage()
    assert policy is not None
    replaced = policy.replaced
    if not node.again and policy.has_attempts_left:
        declared = policy.declared
        pause = declared.pause * declared.backoff ** (policy.attempts - 1)
        oracle_rules.set_alarm(world, min(pause, declared.longest_pause), node, is_pause=True)
    elif not node.again:
        replaced = names
    oracle_failures.retry_task(world, node, None)
    policy.replaced = replaced
    world.retried.append((node.id, policy.declared.fallback if replaced else ""))
    for above in reversed(handlers[: handlers.index(node)]):
        if above.role is Role.EXCEPTION:
            oracle_failures.kill(world, above)


def is_paused(world: World, node: Node) -> bool:
    return any(alarm.node is node and alarm.is_pause for alarm in world.alarms)


def begin_attempt(world: World, node: Node) -> None:
    """Set the alarm of an attempt: a handler has the task."""
    if node.policy is not None and node.policy.declared.attempt_timeout:
        end_attempt(world, node)
        seconds = node.policy.declared.attempt_timeout
        oracle_rules.set_alarm(world, seconds, node, is_attempt=True)


def end_attempt(world: World, node: Node) -> None:
    """Remove the alarm of an attempt: the task is to be handled again."""
    world.alarms = [one for one in world.alarms if one.node is not node or not one.is_attempt]


def send_fallback(world: World, node: Node) -> bool:
    """Send the fallback in place of a task's next handling. Return whether it was due."""
    policy = node.policy
    if policy is None or not policy.replaced:
        return False
    names, policy.replaced = policy.replaced, ()
    message = policy.declared.fallback
    fallback = oracle_rules.make(world, message, Role.EXCEPTION, node, node)
    attachment = Attachment(LAST_RESORT, "", message, 1, "", "central")
    fallback.failing, fallback.resolved = Trouble(node, names, node, attachment, set()), True
    node.recovering = fallback
    return True
