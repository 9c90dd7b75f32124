"""Rules of new messages: their parents, their constraints, and the delays of constraints."""

from tca_tools.check import lives
from tca_tools.check.failing import check_below
from tca_tools.check.records import Hold, MessageRecord
from tca_tools.check.rules import CONSTRAINT, DELAY, ORDER, PARENT, PLAIN, PRESENT, SETTLED, TAPPED
from tca_tools.check.world import JournalWorld
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import ROOT
from tca_wire.rules import NO_GOAL
from tca_wire.vocabulary import Role

ROUNDING = 1e-9
"""The tolerance for rounding of sums of times, in seconds."""

CENTRAL = "central"
_WATCHING = (Role.CONDITION, Role.SET_UP, Role.ACTION)


def received(world: JournalWorld, fact: facts.Received) -> None:
    """Apply that a message was sent."""
    world.new_number(fact.id, fact.message)
    if fact.id in world.items or fact.id in world.over:
        return
    if world.is_whole and fact.sender not in world.joined and fact.sender != CENTRAL:
        what = f"{fact.message} {{{fact.id}}} was sent by '{fact.sender}', which is not connected"
        world.report(PRESENT, fact.id, what)
    item = MessageRecord(
        fact.id,
        fact.message,
        fact.message_class,
        fact.sender,
        fact.sender,
        fact.body,
        role=fact.role,
        about=fact.about,
    )
    world.add(item)
    if item.role:
        _made_by_central(world, item)
    if item.message_class.fans_out and not item.message_class.has_reply:
        world.finish(item)  # only its copies are under way
    if item.is_task:
        _plant(world, item, fact)
    elif fact.parent != ROOT or fact.constraints:
        world.report(PLAIN, item, f"is under {world.name(fact.parent)}, or constrained")
    elif not item.message_class.fans_out:
        what = "was sent, but is neither in a handler nor in a queue"
        world.expect(lambda: item.is_begun or item.is_queued or item.is_over, SETTLED, item, what)


def _made_by_central(world: JournalWorld, item: MessageRecord) -> None:
    """Connect a message that central made with the message it was made for."""
    about = world.items.get(item.about) or world.over.get(item.about)
    item.sent_by = about.sent_by if about is not None else ""
    if item.role is Role.LISTENER:
        listens = f"listens to {world.name(item.about)}, but no wiretap was fired"
        world.expect(lambda: item.tap or not world.is_whole, TAPPED, item, listens)
    monitor = world.items.get(item.about)
    sent_for = monitor if item.role.is_of_monitor else item
    item.is_tapped = sent_for is not None and sent_for.role is not Role.LISTENER
    if item.role in _WATCHING and monitor is not None:
        monitor.is_retry_due = False  # a retried monitor is watching again
        monitor.open_query = item.id if item.role is Role.CONDITION else monitor.open_query
        monitor.has_fired |= item.role is Role.ACTION
        world.touched[monitor] = None
        world.flagged.append(monitor)


def _plant(world: JournalWorld, item: MessageRecord, fact: facts.Received) -> None:
    """Add a task to the tree."""
    lives.sent(world, item)
    parent = world.task(fact.parent, "got a child") if fact.parent != ROOT else None
    if parent is None and fact.parent != ROOT:
        item.is_orphan = True
        if fact.parent >= item.id:
            world.report(PARENT, item, f"is under {world.name(fact.parent)}, which is not older")
    if parent is not None:
        item.parent, item.is_orphan = parent, parent.is_orphan
        parent.children[item.id] = item
        parent.unplanned += item.is_goal
        kind = item.message_class
        item.is_background = kind.is_monitor and kind.is_interval_monitor
        parent.background_monitors += item.is_background
        item.is_suspended = parent.is_suspended and not item.role.runs_while_suspended
        if parent.is_killed:
            world.later.append(lambda: check_below(world, parent))
    _constrain(world, fact.constraints)
    if not item.is_goal:
        what = "was not planned when it was sent, and is not a goal"
        world.expect(lambda: not ~item.reached & NO_GOAL.at_birth, ORDER, item, what)


# --- constraints ----------------------------------------------------------------------------------


def constrained(world: JournalWorld, fact: facts.Constrained) -> None:
    """Apply new constraints between tasks that exist."""
    _constrain(world, fact.constraints)


def _constrain(world: JournalWorld, constraints: list[Constraint]) -> None:
    for constraint in constraints:
        after = world.task(constraint.after.task, "got a constraint")
        if after is None:
            continue
        if after.reached & int(constraint.after.moment):
            world.report(
                CONSTRAINT, after, f"got constraint {constraint} on a moment that it had reached"
            )
        # The first task may be over, or from before the journal
        first, before = constraint.before.task, None
        if first != ROOT and first not in world.over:
            before = world.item(first, "is waited for")
        after.is_incomplete |= before is None and world.is_from_before(first)
        hold = Hold(constraint, before, constraint.delay if first == ROOT else None)
        after.holds.append(hold)
        if before is not None:
            before.followers.append((hold, after))


def timed_out(world: JournalWorld, after: MessageRecord, fact: facts.TimedOut) -> None:
    """Apply that a delay is over."""
    constraint = fact.constraint
    delays = (hold for hold in after.holds if hold.constraint == constraint)
    hold = next((hold for hold in delays if not hold.is_over), None)
    if hold is None:
        wrong = "" if after.is_incomplete else "that it never had, or twice"
    else:
        hold.is_over = True
        wrong = _too_soon(world, hold)
    if wrong:
        world.report(DELAY, after, f"got past a delay {wrong}: {constraint}")


def _too_soon(world: JournalWorld, hold: Hold) -> str:
    """Return by how much a delay ended too early; "" if it did not, or if its start is unknown."""
    if hold.due is None:
        is_known = hold.before is not None and not hold.before.is_incomplete
        return "before it started" if is_known else ""
    return f"{hold.due - world.now:.6g} s too early" if world.now < hold.due - ROUNDING else ""
