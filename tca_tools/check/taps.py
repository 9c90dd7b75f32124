"""Rules of wiretaps and monitors: the tasks they hold back, and when they send messages."""

from tca_tools.check.records import Hold, MessageRecord
from tca_tools.check.rules import KEPT, MONITOR, TAPPED
from tca_tools.check.world import JournalWorld
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import ROOT, START_HANDLING, Moment, Point, TaskId
from tca_wire.rules import CONDITIONS
from tca_wire.vocabulary import CENTRAL, Role


def tap_added(world: JournalWorld, fact: facts.TapAdded) -> None:
    """Apply that a wiretap is added."""
    world.new_number(fact.id, "wiretap")
    if fact.task in world.over:  # such a wiretap fires at once or never
        world.late_taps.add(fact.id)
        what = (
            f"{world.name(fact.task)} got wiretap {{{fact.id}}} after its end, but it was not fired"
        )
        world.expect(lambda: fact.id not in world.late_taps, TAPPED, fact.task, what)
    elif fact.task != ROOT:
        world.task(fact.task, "got a wiretap")
    world.taps[fact.id] = fact
    if CONDITIONS[fact.condition].held_moment:
        world.taps_before.setdefault(fact.message, {})[fact.id] = fact


def forget_task(world: JournalWorld, item: MessageRecord) -> None:
    """Forget the wiretaps of a task that has ended."""
    of_message = world.taps_before.get(item.message)
    for tap in [tap for tap in of_message.values() if tap.task == item.id] if of_message else ():
        del world.taps_before[item.message][tap.id]


def fired(world: JournalWorld, fact: facts.TapFired) -> None:
    """Apply that a wiretap sends its listener."""
    tap, tapped = world.taps.get(fact.tap), world.items.get(fact.tapped)
    world.late_taps.discard(fact.tap)
    if tap is None:
        if world.is_whole:
            world.report(
                TAPPED, fact.tapped, f"wiretap {{{fact.tap}}} was fired, but does not exist"
            )
        elif tapped is not None:
            tapped.is_incomplete = True  # the wiretap may hold the task
        return
    if tapped is not None:
        _mark_passed(world, tap, tapped, fact.listener)
    listener = world.item(fact.listener, "was sent by a wiretap") if fact.listener else None
    if listener is None:
        return
    if listener.tap:
        world.report(TAPPED, listener, "was sent by a wiretap twice")
    listener.tap = tap.id
    if (
        listener.role is not Role.LISTENER
        or listener.about != fact.tapped
        or listener.message != tap.listener
    ):
        what = f"was sent for {world.name(fact.tapped)}, but the listener is {tap.listener}"
        world.report(TAPPED, listener, what)
    rule = CONDITIONS[tap.condition]
    if tapped is not None and tapped.is_task and listener.is_task and rule.holds_until:
        _hold(tapped, listener, rule.held_moment, rule.holds_until)


def refused(world: JournalWorld, fact: facts.RequestRefused) -> None:
    """Apply that central refused a listener: queues are full, or listeners tap each other."""
    world.is_listener_refused = fact.sender == CENTRAL


def _mark_passed(
    world: JournalWorld, tap: facts.TapAdded, tapped: MessageRecord, listener: int
) -> None:
    tapped.taps_passed[tap.id] = listener or world.is_listener_refused
    if tapped.message != tap.message or tap.task not in (ROOT, tapped.id):
        whose = world.name(tap.task) if tap.task else tap.message
        world.report(TAPPED, tapped.id, f"wiretap {{{tap.id}}} of {whose} was fired for {tapped}")


def _hold(tapped: MessageRecord, listener: MessageRecord, moment: int, end: int) -> None:
    # The tapped task may be handled again
    is_pending = moment == START_HANDLING or not tapped.reached & moment
    if is_pending and not listener.reached & end:
        points = Point(TaskId(listener.id), Moment(end)), Point(TaskId(tapped.id), Moment(moment))
        hold = Hold(Constraint(*points), listener, None)
        tapped.holds.append(hold)
        listener.followers.append((hold, tapped))


def check_fired(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    """Check that a task continues only after its wiretaps have fired.

    A wiretap without a handler for its listener does not fire. A message that was sent for a
    wiretap is not tapped. If this message is a monitor, the messages of the monitor are not tapped
    either.
    """
    of_message = world.taps_before.get(item.message)
    if not of_message or not item.is_tapped or not item.is_task:
        return
    for tap in of_message.values():
        if not CONDITIONS[tap.condition].held_moment & moments or tap.task not in (ROOT, item.id):
            continue
        which = f"wiretap {{{tap.id}}} ({tap.listener} {tap.condition})"
        if tap.id not in item.taps_passed:
            world.report(TAPPED, item, f"continued, but {which} was not fired")
        elif not item.taps_passed[tap.id] and world.is_whole and world.handlers.get(tap.listener):
            what = f"continued, but {which} was passed over, though its listener has a handler"
            world.report(TAPPED, item, what)


# --- monitors -------------------------------------------------------------------------------------


def monitor(world: JournalWorld, number: int, what: str) -> MessageRecord | None:
    """Return the monitor of a number; None, after an error, if there is no such monitor.

    Also None for a monitor with unknown constraints.
    """
    item = world.task(number, what)
    if item is None or item.is_incomplete:
        return None
    if not item.message_class.is_monitor:
        world.report(MONITOR, item, f"{what}, but is not a monitor")
        return None
    return item


def outlives_retry(_: JournalWorld, item: MessageRecord, __: facts.OutlivesRetry) -> None:
    """Apply that a monitor was set up by another module than its parent's handler."""
    item.is_foreign_monitor = True


def waited_for(_: JournalWorld, item: MessageRecord, __: facts.WaitedFor) -> None:
    """Apply that a parent waits for the end of a monitor."""
    if item.is_background and item.parent is not None:
        item.is_background = False
        item.parent.background_monitors -= 1


def check_watchers(world: JournalWorld, item: MessageRecord) -> None:
    """Check that a task does not wait for monitors that it should not wait for."""
    if not item.has_returned or not 0 < item.background_monitors == len(item.children):
        return
    for child in item.children.values():
        if not (child.has_returned or child.is_retry_due or child.is_killed or child.is_incomplete):
            world.report(KEPT, child, f"still watches, though {item} waits for nothing else")


def tested(world: JournalWorld, item: MessageRecord, _: facts.MonitorTested) -> None:
    """Apply the test of a monitor's condition."""
    if not item.reached & START_HANDLING:
        world.report(MONITOR, item, "was tested before it started to watch")
    if item.has_returned and not item.is_retry_due:
        world.report(MONITOR, item, "was tested after it had stopped watching")
    if not item.untested:
        world.report(MONITOR, item, "was tested, but its condition was not answered")
    item.untested = 0


def answered(world: JournalWorld, condition: MessageRecord) -> None:
    """Apply the answer to a monitor's query: a watching monitor is tested with the same event."""
    item = world.items.get(condition.about)
    if item is None or item.is_incomplete or item.open_query != condition.id:
        return
    if item.has_returned or item.is_killed:
        return
    item.open_query, item.untested = 0, 1
    world.later.append(lambda: _check_tested(world, item))


def _check_tested(world: JournalWorld, item: MessageRecord) -> None:
    if item.untested and not (item.is_retry_due or item.is_killed):
        world.report(MONITOR, item, "was not tested, though its condition was answered")
    item.untested = 0


def monitor_ended(world: JournalWorld, item: MessageRecord, _: facts.MonitorEnded) -> None:
    """Apply the end of a monitor, also of one that has not started."""
    if item.has_returned and not (item.is_retry_due or item.is_killed):
        world.report(MONITOR, item, "ended a second time")
    item.is_retry_due, item.has_returned, item.open_query = False, True, 0
