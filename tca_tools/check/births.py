"""How messages come into a run: under which parent, with which constraints; and what those hold
back.
"""

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
"""Rounding of sums of times, in seconds."""

CENTRAL = "central"
_WATCHING = (Role.CONDITION, Role.SET_UP, Role.ACTION)


def received(world: JournalWorld, fact: facts.Received) -> None:
    """A message is sent."""
    world.new_number(fact.id, fact.message)
    if fact.id in world.items or fact.id in world.over:
        return
    if world.is_whole and fact.sender not in world.joined and fact.sender != CENTRAL:
        what = f"{fact.message} {{{fact.id}}} was sent by '{fact.sender}', which is not there"
        world.broken(PRESENT, fact.id, what)
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
        world.finish(item)  # it goes on in its copies
    if item.is_task:
        _plant(world, item, fact)
    elif fact.parent != ROOT or fact.constraints:
        world.broken(PLAIN, item, f"is under {world.name(fact.parent)}, or constrained")
    elif not item.message_class.fans_out:
        what = "was sent, and is neither with a handler nor in a queue"
        world.expect(lambda: item.is_begun or item.is_queued or item.is_over, SETTLED, item, what)


def _made_by_central(world: JournalWorld, item: MessageRecord) -> None:
    """Tell what the message was made for."""
    about = world.items.get(item.about) or world.over.get(item.about)
    item.sent_by = about.sent_by if about is not None else ""
    if item.role is Role.LISTENER:
        listens = f"listens to {world.name(item.about)}, and no wiretap was fired"
        world.expect(lambda: item.tap or not world.is_whole, TAPPED, item, listens)
    monitor = world.items.get(item.about)
    sent_for = monitor if item.role.is_of_monitor else item
    item.is_tapped = sent_for is not None and sent_for.role is not Role.LISTENER
    if item.role in _WATCHING and monitor is not None:
        monitor.again = False  # where it was retried, it has begun to watch again
        monitor.asked = item.id if item.role is Role.CONDITION else monitor.asked
        monitor.has_fired = monitor.has_fired or item.role is Role.ACTION
        world.touched[monitor] = None
        world.flagged.append(monitor)


def _plant(world: JournalWorld, item: MessageRecord, fact: facts.Received) -> None:
    """Put a task under its parent."""
    lives.begin(world, item)
    parent = world.task(fact.parent, "got a child") if fact.parent != ROOT else None
    if parent is None and fact.parent != ROOT:
        item.is_orphan = True
        if fact.parent >= item.id:
            world.broken(PARENT, item, f"hangs under {world.name(fact.parent)}, which is no older")
    if parent is not None:
        item.parent, item.is_orphan = parent, parent.is_orphan
        parent.children[item.id] = item
        parent.unplanned += item.is_goal
        item.is_watcher = item.message_class.is_monitor and item.message_class.is_outside_sequence
        parent.watchers += item.is_watcher
        item.is_suspended = parent.is_suspended and not item.role.leaves_safe
        if parent.is_killed:
            world.later.append(lambda: check_below(world, parent))
    _constrain(world, fact.constraints)
    if not item.is_goal:
        what = "was not planned when it was sent, and is no goal"
        world.expect(lambda: not ~item.reached & NO_GOAL.at_birth, ORDER, item, what)


# --- constraints ----------------------------------------------------------------------------------


def constrained(world: JournalWorld, fact: facts.Constrained) -> None:
    """Constraints come between tasks that exist."""
    _constrain(world, fact.constraints)


def _constrain(world: JournalWorld, constraints: list[Constraint]) -> None:
    for constraint in constraints:
        after = world.task(constraint.after.task, "got a constraint")
        if after is None:
            continue
        if after.reached & int(constraint.after.moment):
            world.broken(CONSTRAINT, after, f"got constraint {constraint} when that was past")
        leader = constraint.before.task  # may be over, or from before the journal
        before = (
            world.item(leader, "is waited for")
            if leader != ROOT and leader not in world.over
            else None
        )
        after.is_stranger = after.is_stranger or (before is None and world.is_strange(leader))
        hold = Hold(constraint, before, constraint.delay if leader == ROOT else None)
        after.holds.append(hold)
        if before is not None:
            before.followers.append((hold, after))


def timed_out(world: JournalWorld, after: MessageRecord, fact: facts.TimedOut) -> None:
    """A delay is over."""
    constraint = fact.constraint
    delays = (hold for hold in after.holds if hold.constraint == constraint)
    hold = next((hold for hold in delays if not hold.is_over), None)
    if hold is None:
        wrong = "" if after.is_stranger else "that it never had, or twice"
    else:
        hold.is_over = True
        wrong = _too_soon(world, hold)
    if wrong:
        world.broken(DELAY, after, f"got past a delay {wrong}: {constraint}")


def _too_soon(world: JournalWorld, hold: Hold) -> str:
    """By how much a delay was over too soon; "" if it was not, or if that is not known."""
    if hold.due is None:
        is_known = hold.before is not None and not hold.before.is_stranger
        return "before that began" if is_known else ""
    return f"{hold.due - world.now:.6g} s too early" if world.now < hold.due - ROUNDING else ""
