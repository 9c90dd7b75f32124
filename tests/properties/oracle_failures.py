"""The rules of failures, retries, kills and suspension."""

from collections.abc import Iterator

from properties import oracle_locks, oracle_monitors, oracle_policies, oracle_rules, oracle_taps
from properties.oracle_records import SH, STARTS, Attachment, Ending, Node, Trouble, World

from tca_wire.journal import facts
from tca_wire.vocabulary import Condition, Role, Scope

MOST_NESTED = 8  # nested calls of one attachment
UNINTENDED_FAILURES = {
    "module lost",
    "handler error",
    "bad data",
    "timeout",
    "overload",
    "deadlock",
    "lock lost",
}
"""Failures that no handler raises on purpose."""


# --- kill -----------------------------------------------------------------------------------------


def kill(world: World, node: Node) -> None:
    """End a task and its descendants. Exception handlers, termination messages and cancel messages
    of monitors below the task live on.
    """
    killed = [one for one in _killed_with(world, node) if not one.killed]
    for one in killed:
        one.killed = True
        world.never_began |= {(one.id, moment) for moment in STARTS - one.past}
        oracle_rules.pass_on_leaders(world, one)
        if not one.slot:
            one.returned, one.wanted, one.waiting = True, False, False
    for one in killed:
        oracle_taps.happened(world, one, {Condition.WHEN_KILLED})
        oracle_locks.killed(world, one)
        if one.suspended:
            one.suspended = False
            for child in world.children(one):
                if child.suspended and child not in killed:
                    suspend(world, child, resume=True)
        _clean_up_after_kill(world, one)
        if one.role is Role.EXCEPTION and not one.void:
            one.void = True
            _continue_search(world, one)


def _killed_with(world: World, node: Node) -> list[Node]:
    found = [node]
    for each in found:
        found += [child for child in world.children(each) if not child.survives]
    return found


def _clean_up_after_kill(world: World, node: Node) -> None:
    if SH in node.past:
        for message in node.termination_messages:
            oracle_rules.make(world, message, Role.TERMINATION, node, node)
    oracle_monitors.stop(world, node)
    deciding = node.recovering
    if (
        deciding is not None
        and deciding.id in world.nodes
        and oracle_policies.is_fallback(deciding)
    ):
        kill(world, deciding)
    for listener in node.listeners:
        if listener.id in world.nodes:
            kill(world, listener)


def end(world: World, ending: Ending) -> None:
    """Carry out a requested kill, now that its point is reached: at once, or after its delay."""
    if ending.delay:
        oracle_rules.set_alarm(world, ending.delay, ending.node, ending=ending)
        return
    kill_scope(world, ending)


def kill_scope(world: World, ending: Ending) -> None:
    node = ending.node
    if node is not world.root and node.id not in world.nodes:
        return
    if ending.scope == Scope.TASK:
        kill(world, node)
        return
    parent = node if ending.scope == Scope.DESCENDANTS else node.parent
    assert parent is not None
    for child in world.children(parent):
        if child is not node and not child.survives:
            kill(world, child)


# --- suspend --------------------------------------------------------------------------------------


def suspend(world: World, node: Node, *, resume: bool) -> None:
    for one in world.subtree(node):
        is_resumed, one.suspended = one.suspended and resume, not resume
        if is_resumed and one.watch is not None:
            world.resumed.append(one)


# --- failures -------------------------------------------------------------------------------------


def returned_with_failure(world: World, node: Node, names: tuple[str, ...]) -> None:
    """Apply the failure of a task's handler."""
    if node.killed:
        node.returned = True
    elif node.again:
        retry(world, node)
    elif (handler := _search(world, node, names)) is not None:
        node.recovering = handler
    elif not node.again:  # its retry policy does not deal with it
        node.returned = True


def raise_beside(world: World, node: Node, names: tuple[str, ...]) -> None:
    """Raise a failure on a task. The task's handler is not affected."""
    _search(world, node, names)


def _search(
    world: World, node: Node, names: tuple[str, ...], after: Trouble | None = None
) -> Node | None:
    """Call the next matching exception handler, and return it. If a retry policy comes first, apply
    it. Without either, kill the top-level task, or skip the exception handler in which the failure
    happened. In all these cases return None.
    """
    around = _nearest_exception_handler(node)
    known = around.failing if around else after
    passed = known.passed if known else set()
    for at, attachment in _candidates(world, node, after):
        if attachment is None:
            if oracle_policies.deals_with(world, at, node, names):
                oracle_policies.apply(world, at, node, names)
                return None
            continue
        fits = attachment.failure in ("", *names) and world.handlers.get(attachment.handler)
        exhausted = attachment.maximum and at.calls.get(attachment.id, 0) >= attachment.maximum
        nested = sum(
            above.failing is not None and above.failing.attachment is attachment
            for above in node.lineage()
        )
        if fits and not exhausted and nested < MOST_NESTED and (attachment, names[0]) not in passed:
            at.calls[attachment.id] = at.calls.get(attachment.id, 0) + 1
            handler = oracle_rules.make(world, attachment.handler, Role.EXCEPTION, node, node)
            handler.failing = Trouble(node, names, at, attachment, passed)
            return handler
    if after is not None and node.recovering is not None and node.recovering.failing is after:
        node.recovering = None
    lineage = node.lineage()
    outer = around.failing.node.lineage() if around and around.failing else []
    is_left_behind = any(one.again and one.asking.isdisjoint(lineage) for one in outer)
    has_not_decided = is_left_behind or set(names) & UNINTENDED_FAILURES
    if around and (has_not_decided or oracle_policies.is_fallback(around)):
        _skip(world, around)
        return None
    kill(world, lineage[-1])
    for above in reversed(lineage):
        if above.role is Role.EXCEPTION:
            kill(world, above)
    return None


def _nearest_exception_handler(node: Node) -> Node | None:
    """Return the nearest exception handler among a task and its ancestors."""
    return next((above for above in node.lineage() if above.role is Role.EXCEPTION), None)


def _skip(world: World, handler: Node) -> None:
    """Kill an exception handler that could not decide. The search continues after this handler,
    unless the handler had decided before.
    """
    assert handler.failing is not None
    had_decided, handler.void = handler.void, True
    kill(world, handler)
    if not had_decided:
        handler.failing.passed.add((handler.failing.attachment, handler.failing.names[0]))
        _continue_search(world, handler)


def skip_stranded(world: World) -> bool:
    """Skip the queued exception handlers that no module handles any more, oldest arrival first.
    Return whether any was skipped.
    """
    world.spared &= stranded(world)
    has_begun = oracle_rules.begin_attempts(world, stranded(world))
    if not (due := stranded(world) - world.spared):
        return has_begun
    killed_ids = [int(fact.task) for fact in world.seen.facts if isinstance(fact, facts.Killed)]
    for node in sorted(
        due, key=lambda one: (one.arrival, killed_ids.index(one.id) if one.id in killed_ids else 0)
    ):
        if not node.killed:
            kill(world, node)
    return True


def stranded(world: World) -> set[Node]:
    """Return the queued exception handlers that no module handles."""
    waiting = {
        node for node in world.nodes.values() if node.waiting and node.role is Role.EXCEPTION
    }
    return {node for node in waiting if not world.handlers.get(node.message)}


def _candidates(
    world: World, node: Node, after: Trouble | None
) -> Iterator[tuple[Node, Attachment | None]]:
    """Walk from the failing task up to the root. At each task, yield None for its retry policy,
    then its own attachments, then those of its message, newest first. With *after*, yield only what
    comes after the attachment of *after*.
    """
    for at in [*node.lineage(), world.root]:
        own = sorted(at.attached, key=lambda one: -one.id)
        of_message = sorted(world.attached.get(at.message, []), key=lambda one: -one.id)
        if after is None:
            yield at, None
            yield from ((at, one) for one in [*own, *of_message])
        elif at is after.at:
            is_own = after.is_own
            rest = [one for one in own if is_own and one.id < after.attachment.id]
            rest += [one for one in of_message if is_own or one.id < after.attachment.id]
            yield from ((at, one) for one in rest)
            after = None


def reissue(world: World, handler: Node) -> None:
    """End an exception handler that has reissued its failure. The search continues, unless the
    handler had decided before.
    """
    had_decided, handler.void = handler.void, True
    if not had_decided:
        _continue_search(world, handler)
    handler.returned = True


def _continue_search(world: World, handler: Node) -> None:
    trouble = handler.failing
    assert trouble is not None
    node = trouble.node
    if node.killed:
        return
    decides = node.recovering is handler
    following = _search(world, node, trouble.names, trouble)
    if decides:
        node.recovering = following
        node.returned |= following is None and not node.again


def handler_ended(world: World, handler: Node) -> None:
    """Apply the end of an exception handler with all its descendants."""
    assert handler.failing is not None
    node = handler.failing.node
    if handler.void or node.killed:
        return
    if not handler.resolved:
        _continue_search(world, handler)
    elif node.recovering is handler:
        node.recovering, node.returned = None, True


def resolve(handler: Node) -> None:
    """Mark the failure of an exception handler as resolved. The mark counts when the handler ends,
    unless the handler is void by then.
    """
    assert handler.failing is not None
    handler.resolved |= not (
        handler.void or handler.again or handler.killed or handler.failing.node.killed
    )


def retry(world: World, node: Node) -> None:
    """Let a started task be handled once more, like a new one."""
    node.again, node.wanted, node.returned = True, True, False
    node.fired -= oracle_taps.taps_to_repeat(world, node)
    node.waiting = False


def retry_now(world: World, node: Node, connection: str) -> None:
    """Carry out a requested retry. The task's descendants end first, except foreign monitors. A
    task that has not started only fires its *before* taps again.
    """
    at_work = [one for one in world.everything() if one.slot == connection]
    found = max(at_work, key=lambda one: one.turn, default=None)
    asking = found if isinstance(found, Node) and found.role is Role.EXCEPTION else None
    if asking is not None:
        asking.resolved = True
    retry_task(world, node, asking)


def retry_task(world: World, node: Node, asking: Node | None) -> None:
    """Let a task be handled again, on request of an exception handler, or by another cause."""
    node.resolved = oracle_policies.is_fallback(node)
    oracle_policies.end_attempt(world, node)
    if node.policy is not None:
        node.policy.replaced = ()
    for child in world.children(node):
        child.void |= child.role is Role.EXCEPTION
    if SH not in node.past:
        oracle_taps.fire_again(world, node)
        return
    oracle_monitors.stop(world, node)
    for child in world.children(node):
        if not (child.survives or child.is_foreign):
            kill(world, child)
    if asking is not None:
        node.asking.add(asking)
    retry(world, node)
    if node.kind.is_monitor:  # it does not start again if all else under its parent has ended
        oracle_monitors.end_due_monitors(world)
