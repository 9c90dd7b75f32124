"""Journals of the real core, and changes to such journals: one fact lost or duplicated."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from central.player import INTEGER, Player, before, point
from central.transcript import Transcript

from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.rules import Violation
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, kind_of
from tca_wire.journal.records import record
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass

OPENED = Entry(0, 0.0, [facts.Opened(JOURNAL_VERSION, "epoch", 1, 1_700_000_000.0, "0.1.0")])


def checked(entries: Iterable[Entry]) -> list[Violation]:
    """Return the breaches of rules in a journal."""
    checker = CheckedRun()
    for entry in entries:
        checker.apply(entry)
    checker.close()
    return checker.violations


def walk() -> list[Entry]:
    """Return the journal of a walk with everything: queries, failures, retries, wiretaps, monitors,
    kills, suspension, locks, delays.
    """
    player = Player()
    _join(player)
    _walk(player)
    _talk(player)
    _finish(player)
    return [OPENED, *player.entries]


def _join(player: Player) -> None:
    player.module("planner", "goal walk", "goal step", capacity=2)
    player.module("legs", "command move", "query where", "inform note")
    player.module("checker", "command check")
    player.module("maps", "multi-query all", "broadcast pose", "variable mode")
    player.module("expert", "exception handler recover")
    player.module("user")
    monitor = MessageFormat("look", MessageClass.POINT_MONITOR, INTEGER, "", ["where", "note"])
    player.request("user", headers.Register, [monitor])
    player.request("user", headers.Tap, Condition.BEFORE_HANDLING, "check", "move", TaskId(0))
    player.request("user", headers.Attach, Attachment("slipped", "recover", 1), TaskId(0), "move")


def _walk(player: Player) -> None:
    top = player.task("user", "walk")
    player.request("user", headers.AwaitPoint, point(top, Moment.END_ACHIEVING))
    first = player.task("planner/1", "step", under=top)
    second = player.task("planner/1", "step", under=top)
    held = (before(point(first, Moment.START_ACHIEVING), point(-1, Moment.START_ACHIEVING), 3.0),)
    player.send("planner/1", "look", under=top, watch=WatchOptions(), constraints=held)
    player.reply("planner/1")
    _step(player, first, slips=True)
    player.request("user", headers.Suspend, TaskId(second))
    player.request("user", headers.Suspend, TaskId(second), True)
    _step(player, second, slips=False)


def _talk(player: Player) -> None:
    player.request("maps", headers.Lock, "legs", "legs")
    player.send("user", "note")
    player.receive("maps", headers.GiveUp(player.numbers["maps"]))
    player.reply("legs/1", value=1)
    player.send("user", "pose")
    player.reply("maps/1")
    player.set_variable("user", "mode", 3)
    player.reply("maps/1")
    player.send("user", "all")
    player.reply("maps/1", value=1)
    player.tick(10)
    while any(player.delivered(slot) for slot in ("legs/1", "checker/1")):
        for slot in ("legs/1", "checker/1"):
            if player.delivered(slot):
                player.reply(slot, value=1)


def _finish(player: Player) -> None:
    for _ in range(2):
        player.request("maps", headers.Lock, "legs", "legs")
        player.receive("maps", headers.GiveUp(player.numbers["maps"]))
    player.send("user", "note")
    player.reply("legs/1")
    in_vain = player.task("user", "walk")
    player.task("user", "move", under=in_vain)
    player.request("user", headers.Kill, TaskId(in_vain), "enough")
    for slot in ("planner/1", "planner/2", "checker/1"):
        while player.delivered(slot):
            player.reply(slot)
    player.lose("legs/1")


def _step(player: Player, step: int, *, slips: bool) -> None:
    """Plan a step, then walk it. A step that slips is retried."""
    planner = next(slot for slot in ("planner/1", "planner/2") if step in player.delivered(slot))
    player.send(planner, "where", under=step, origin=step)
    player.reply("legs/1", value=5)
    move = player.task(planner, "move", under=step, flags=Flags.SEQ_ACH)
    player.reply(planner, step)
    player.reply("checker/1")
    if slips:
        player.fail("legs/1", "slipped")
        player.request("expert/1", headers.Retry, TaskId(move))
        player.reply("expert/1")
        player.reply("checker/1")
    player.reply("legs/1")


Change = Callable[[list[facts.Fact], int], list[facts.Fact]]


def lost(facts_before: list[facts.Fact], place: int) -> list[facts.Fact]:
    return facts_before[:place] + facts_before[place + 1 :]


def duplicated(facts_before: list[facts.Fact], place: int) -> list[facts.Fact]:
    return facts_before[: place + 1] + facts_before[place:]


def changed(entries: list[Entry], change: Change, *kinds: str) -> Iterator[tuple[str, list[Entry]]]:
    """Yield journals with one changed fact each. Each fact of the given kinds (default: all) is
    changed in turn.
    """
    for number, entry in enumerate(entries):
        for place, fact in enumerate(entry.facts):
            if not kinds or kind_of(fact) in kinds:
                other = Entry(entry.number, entry.time, change(entry.facts, place))
                yield f"{kind_of(fact)} {fact}", [*entries[:number], other, *entries[number + 1 :]]


TRANSCRIPTS = Path(__file__).parent.parent / "central" / "transcripts"


def played(transcript: str) -> Player:
    """Return the player of a transcript, after its last command."""
    replayed = Transcript()
    for block in (TRANSCRIPTS / f"{transcript}.txt").read_text().strip().split("\n\n")[1:]:
        for command in block.split("\n----")[0].splitlines():
            replayed.play(command)
    return replayed.player


def encoded(entries: Iterable[Entry]) -> bytes:
    return b"".join(map(record, entries))
