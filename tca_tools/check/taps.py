"""Wiretaps and monitors: what they hold back, and when they send messages."""

from tca_tools.check.records import Hold, MessageRecord
from tca_tools.check.rules import KEPT, MONITOR, TAPPED
from tca_tools.check.world import JournalWorld
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import ROOT, START_HANDLING, Moment, Point, TaskId
from tca_wire.rules import CONDITIONS
from tca_wire.vocabulary import CENTRAL, Role


def tap_added(world: JournalWorld, fact: facts.TapAdded) -> None:
    """A wiretap is added."""
    world.new_number(fact.id, "wiretap")
    if fact.task in world.over:  # it calls at once, or not at all
        world.late_taps.add(fact.id)
        what = (
            f"{world.name(fact.task)} got wiretap {{{fact.id}}} after its end, and it was not fired"
        )
        world.expect(lambda: fact.id not in world.late_taps, TAPPED, fact.task, what)
    elif fact.task != ROOT:
        world.task(fact.task, "got a wiretap")
    world.taps[fact.id] = fact
    if CONDITIONS[fact.condition].before:
        world.taps_before.setdefault(fact.message, {})[fact.id] = fact


def forget_task(world: JournalWorld, item: MessageRecord) -> None:
    """Forget the wiretaps of a task that has ended."""
    of_message = world.taps_before.get(item.message)
    for tap in [tap for tap in of_message.values() if tap.task == item.id] if of_message else ():
        del world.taps_before[item.message][tap.id]


def fired(world: JournalWorld, fact: facts.TapFired) -> None:
    """A wiretap sends its listener."""
    tap, tapped = world.taps.get(fact.tap), world.items.get(fact.tapped)
    world.late_taps.discard(fact.tap)
    if tap is None:
        if world.is_whole:
            world.broken(TAPPED, fact.tapped, f"wiretap {{{fact.tap}}} was fired, and is not there")
        elif tapped is not None:
            tapped.is_stranger = True  # what holds it is not known
        return
    if tapped is not None:
        _pass(world, tap, tapped, fact.listener)
    listener = world.item(fact.listener, "was sent by a wiretap") if fact.listener else None
    if listener is None:
        return
    if listener.tap:
        world.broken(TAPPED, listener, "was sent by a wiretap twice")
    listener.tap = tap.id
    if (
        listener.role is not Role.LISTENER
        or listener.about != fact.tapped
        or listener.message != tap.listener
    ):
        world.broken(
            TAPPED, listener, f"was sent for {world.name(fact.tapped)}: {tap.listener} should be"
        )
    if (
        tapped is not None
        and tapped.is_task
        and listener.is_task
        and (end := CONDITIONS[tap.condition].holds_until)
    ):
        _hold(tapped, listener, CONDITIONS[tap.condition].before, end)


def refused(world: JournalWorld, fact: facts.RequestRefused) -> None:
    """Central says that it sends no listener: there is no room, or too many listen to each
    other.
    """
    world.kept_out = fact.sender == CENTRAL


def _pass(world: JournalWorld, tap: facts.TapAdded, tapped: MessageRecord, listener: int) -> None:
    tapped.passed[tap.id] = listener or world.kept_out
    if tapped.message != tap.message or tap.task not in (ROOT, tapped.id):
        whose = world.name(tap.task) if tap.task else tap.message
        world.broken(TAPPED, tapped.id, f"wiretap {{{tap.id}}} of {whose} was fired for {tapped}")


def _hold(tapped: MessageRecord, listener: MessageRecord, moment: int, end: int) -> None:
    is_to_come = (
        moment == START_HANDLING or not tapped.reached & moment
    )  # it may be handled once more
    if is_to_come and not listener.reached & end:
        points = Point(TaskId(listener.id), Moment(end)), Point(TaskId(tapped.id), Moment(moment))
        hold = Hold(Constraint(*points), listener, None)
        tapped.holds.append(hold)
        listener.followers.append((hold, tapped))


def check_fired(world: JournalWorld, item: MessageRecord, moments: int) -> None:
    """Check that a task goes on only after its wiretaps have fired; those without a handler for the
    listener do not. What is sent for a wiretap is not tapped, nor what a monitor sends that was.
    """
    of_message = world.taps_before.get(item.message)
    if not of_message or not item.is_tapped or not item.is_task:
        return
    for tap in of_message.values():
        if not CONDITIONS[tap.condition].before & moments or tap.task not in (ROOT, item.id):
            continue
        which = f"wiretap {{{tap.id}}} ({tap.listener} {tap.condition})"
        if tap.id not in item.passed:
            world.broken(TAPPED, item, f"went on, and {which} was not fired")
        elif not item.passed[tap.id] and world.is_whole and world.handlers.get(tap.listener):
            world.broken(
                TAPPED, item, f"went on, and {which} was passed over, though somebody handles it"
            )


# --- monitors -------------------------------------------------------------------------------------


def monitor(world: JournalWorld, number: int, what: str) -> MessageRecord | None:
    """The monitor of that number; None, with a complaint if it can't be, or if nothing can be
    claimed of it.
    """
    item = world.task(number, what)
    if item is None or item.is_stranger:
        return None
    if not item.message_class.is_monitor:
        world.broken(MONITOR, item, f"{what}, and is no monitor")
        return None
    return item


def spared(_: JournalWorld, item: MessageRecord, __: facts.OutlivesRetry) -> None:
    """Others than the handler of the task above have put a monitor there."""
    item.is_guest = True


def waited_for(_: JournalWorld, item: MessageRecord, __: facts.WaitedFor) -> None:
    """A monitor was sent to be waited for."""
    if item.is_watcher and item.parent is not None:
        item.is_watcher = False
        item.parent.watchers -= 1


def check_watchers(world: JournalWorld, item: MessageRecord) -> None:
    """Check that a task is not kept by monitors that were not sent to be waited for."""
    if not item.returned or not 0 < item.watchers == len(item.children):
        return
    for child in item.children.values():
        if not (child.returned or child.again or child.is_killed or child.is_stranger):
            world.broken(KEPT, child, f"still watches, and {item} waits for nothing else")


def tested(world: JournalWorld, item: MessageRecord, _: facts.MonitorTested) -> None:
    """The condition of a monitor was asked."""
    if not item.reached & START_HANDLING:
        world.broken(MONITOR, item, "was tested, and had not begun to watch")
    if item.returned and not item.again:
        world.broken(MONITOR, item, "was tested, and watches no longer")
    if not item.untested:
        world.broken(MONITOR, item, "was tested, and its condition was not answered")
    item.untested = 0


def answered(world: JournalWorld, condition: MessageRecord) -> None:
    """The condition of a monitor was answered: it is tested with the same event, if it still
    watches.
    """
    item = world.items.get(condition.about)
    if (
        item is None
        or item.is_stranger
        or item.asked != condition.id
        or item.returned
        or item.is_killed
    ):
        return
    item.asked, item.untested = 0, 1
    world.later.append(lambda: _check_tested(world, item))


def _check_tested(world: JournalWorld, item: MessageRecord) -> None:
    if item.untested and not (item.again or item.is_killed):
        world.broken(MONITOR, item, "was not tested, and its condition was answered")
    item.untested = 0


def monitor_ended(world: JournalWorld, item: MessageRecord, _: facts.MonitorEnded) -> None:
    """A monitor ends; one that has not begun never will begin."""
    if item.returned and not (item.again or item.is_killed):
        world.broken(MONITOR, item, "ended a second time")
    item.again, item.returned, item.asked = False, True, 0
