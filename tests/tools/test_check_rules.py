"""The rules of a journal. Central keeps them, and one wrong fact is found."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from central.player import INTEGER, Player
from central.test_prefetched_messages import Ears, trust_every_handler
from central.test_prefetched_messages import deliveries as got
from central.transcript import Transcript
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from properties.life import Life, Operations, operations
from properties.test_late_taps import CheckedLife
from sampling import lives
from tools.runs import OPENED, TRANSCRIPTS, Change, changed, checked, duplicated, lost, played, walk
from tools.story import stumbling

from tca_central.order.holds import Holds
from tca_central.requests import joining
from tca_central.watching import taps
from tca_tools.check import rules
from tca_tools.check.checked_run import CheckedRun
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, kind_of
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.points import START_HANDLING, TaskId
from tca_wire.vocabulary import MessageClass

WALK = walk()

WITHOUT_TRACE = {"opened", "format", "resource", "queued", "retried"}
"""Kinds of facts on which no other fact depends. One fact more or less of these kinds breaks no
rule.
"""


# --- central keeps the rules ----------------------------------------------------------------------


def test_full_walk_keeps_all_rules() -> None:
    kinds = {kind_of(fact) for entry in WALK for fact in entry.facts}
    wanted = {
        "caught",
        "retried",
        "killed",
        "tested",
        "tapped",
        "granted",
        "delay over",
        "suspended",
        "wait ended",
    }
    assert wanted <= kinds
    assert checked(WALK) == []


@pytest.mark.parametrize("path", sorted(TRANSCRIPTS.glob("*.txt")), ids=lambda path: path.stem)
def test_transcripts_keep_the_rules_from_any_entry_on(path: Path) -> None:
    player, run = played(path.stem), CheckedRun()
    entries = [OPENED, *player.entries]
    starts = range(0, len(entries), lives(7, soak=1))
    assert [start for start in starts if checked(entries[start:])] == []
    for entry in entries:
        run.apply(entry)
    for task in player.central.tree.tasks.values():
        known = run.world.items[task.id]
        if not task.message.message_class.is_monitor:
            found = (known.state, known.serial, known.body)
            assert found == (task.state, task.serial, task.body), str(task)


def test_prefetched_message_begun_before_unregister_keeps_rules(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    trust_every_handler(monkeypatch)
    player = Ears.of("ear: query where", "user")
    for _ in range(3):
        player.send("user", "where")
    first, _, third = got(player, "ear/1")
    player.request("ear", headers.Unregister, [])
    player.reply("ear/1", first)
    player.receive("ear/1", headers.Recalled([third]))
    assert len(player.facts(facts.Delivered)) == 2
    assert checked([OPENED, *player.entries]) == []


@given(operations)
@settings(max_examples=lives(20, soak=500))
def test_random_lives_keep_the_rules(taken: Operations) -> None:
    life = Life(Player(check=False)).live(taken)
    assert checked([OPENED, *life.player.entries]) == []


@given(st.integers(0, 1 << 32))
@example(80069)  # in the soak's length: an unknown watcher ends
@example(628175043)  # a retry policy ends the exception handler of a safety task below
@settings(max_examples=lives(2, soak=100))
def test_long_random_lives_keep_the_rules_from_any_entry_on(seed: int) -> None:
    life = Life(Player(check=False))
    life.go_on(seed, lives(700, soak=2_000))
    entries = life.player.entries
    assert checked([OPENED, *entries]) == []
    for start in range(7, len(entries), 60):
        assert checked(entries[start:]) == []


# --- wrong facts are found ------------------------------------------------------------------------


@pytest.mark.parametrize("change", [lost, duplicated])
def test_lost_or_duplicated_fact_is_found(change: Change) -> None:
    missed = [what for what, entries in changed(WALK, change) if not checked(entries)]
    kinds = Counter(what.partition(" ")[0] for what in missed)
    for kind in WITHOUT_TRACE:
        del kinds[kind]
    # A returned copy and a kill as the cause of an end leave no other trace.
    assert kinds <= Counter({"returned": 1, "killed": 1})


def test_fact_one_event_late_is_found() -> None:
    for number in range(1, len(WALK) - 1):
        entry, following = WALK[number : number + 2]
        if kind_of(entry.facts[-1]) in ("reached", "answered", "caught"):
            late = Entry(entry.number, entry.time, entry.facts[:-1])
            after = Entry(following.number, following.time, [*following.facts, entry.facts[-1]])
            assert checked([*WALK[:number], late, after, *WALK[number + 2 :]]), entry.facts[-1]


def test_swapped_entries_are_found() -> None:
    for number in range(1, len(WALK) - 1):
        assert checked([*WALK[:number], WALK[number + 1], WALK[number], *WALK[number + 2 :]])


@pytest.mark.parametrize("missing", [facts.WaitBegan, facts.WaitEnded])
def test_wait_without_its_begin_or_end_is_found(missing: type[facts.Fact]) -> None:
    player = Player.of("legs: command move", "user")
    task = player.task("user", "move")
    player.receive("user", Observe(number := player.number("user"), TaskId(task)))
    player.receive(
        "user", headers.Await(number, seen=2)
    )  # the current state, and the end of the list
    player.reply("legs/1")
    entries = [OPENED, *player.entries]
    assert checked(entries) == []
    left = [
        replace(entry, facts=[one for one in entry.facts if not isinstance(one, missing)])
        for entry in entries
    ]
    assert {violation.rule for violation in checked(left)} == {rules.WAITS.text}


def test_monitor_that_outlasts_its_watched_task_is_found() -> None:
    player = Player.of("planner: goal walk", "eye: query seen", "user")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["seen", ""])
    player.request("user", headers.Register, [watch])
    walk = player.task("user", "walk")
    monitor = player.task("planner/1", "watch", under=walk, watch=WatchOptions(5.0))
    player.reply("planner/1")
    *before, last = [OPENED, *player.entries]
    assert checked([*before, last]) == []
    ending = next(
        number for number, fact in enumerate(last.facts) if isinstance(fact, facts.MonitorEnded)
    )
    (broken,) = checked([*before, replace(last, facts=last.facts[:ending])])
    text = f"watch {{{monitor}}} still watches, though walk {{{walk}}} waits for nothing else"
    assert (broken.rule, broken.what) == (rules.KEPT.text, text)


# --- journals with missing parts ------------------------------------------------------------------


def _gaps(entries: list[Entry]) -> tuple[list[str], list[str]]:
    checker = CheckedRun()
    for entry in entries:
        checker.apply(entry)
    checker.close()
    return checker.gaps, [violation.what for violation in checker.violations]


def test_journal_from_mid_segment_reports_a_gap_and_no_breach() -> None:
    for start in range(2, len(WALK), 9):
        assert _gaps(WALK[start:]) == (
            ["it starts in the middle of a segment: messages sent before are unknown"],
            [],
        )


def test_missing_segment_reports_a_gap_and_no_breach() -> None:
    opened = facts.Opened(facts.JOURNAL_VERSION, "epoch", 3, 0.0, "0.1.0")
    middle = len(WALK) // 2
    entries = [*WALK[:9], Entry(WALK[middle].number, WALK[middle].time, [opened]), *WALK[middle:]]
    gaps, found = _gaps(entries)
    assert gaps == [
        f"missing: 1 segment before segment 3; messages sent before {WALK[middle].time:.2f} s are unknown"
    ]
    assert found == []


def test_second_run_in_a_journal_reports_a_gap_and_no_breach() -> None:
    other = Entry(0, 0.0, [facts.Opened(facts.JOURNAL_VERSION, "other", 1, 0.0, "0.1.0")])
    gaps, found = _gaps([*WALK, other, *WALK[1:]])
    assert gaps == ["at 0.00 s another run starts (other)"]
    assert found == []


def test_event_split_into_several_records_breaks_no_rule() -> None:
    halves = [
        half
        for entry in WALK
        for half in (
            Entry(entry.number, entry.time, entry.facts[: len(entry.facts) // 2]),
            Entry(entry.number, entry.time, entry.facts[len(entry.facts) // 2 :]),
        )
    ]
    assert checked(halves) == []


def test_handmade_journal_is_found_to_break_rules() -> None:
    """Builders of stories leave out facts that matter to the checker."""
    assert checked(stumbling().entries)


def test_checker_forgets_ended_messages() -> None:
    checker = CheckedRun()
    life = Life(Player(check=False))
    life.go_on(7, 1_500)
    for entry in [OPENED, *life.player.entries]:
        checker.apply(entry)
    checker.close()
    assert len(checker.world.items) < len(checker.world.over) / 3


def test_every_rule_names_its_source() -> None:
    assert len(rules.RULES) > 25
    assert all(rule.text and rule.source for rule in rules.RULES)


# --- wiretaps -------------------------------------------------------------------------------------


Patch = pytest.MonkeyPatch


class PlayedLife(CheckedLife):
    """A life with late wiretaps, without the reference scheduler."""

    def __init__(self) -> None:
        self.timers = 0
        Life.__init__(self, Player(check=False))


@given(st.integers(0, 1 << 32))
@settings(max_examples=40)
def test_late_wiretaps_keep_the_rules_from_any_entry_on(
    seed: int,
) -> None:
    life = PlayedLife()
    life.go_on(seed, 200)
    assert checked([OPENED, *life.player.entries]) == []
    for start in (30, 120):
        assert checked(life.player.entries[start:]) == []


def skip_waiting_messages(patch: Patch) -> None:
    patch.setattr(taps, "_apply_to_waiting", lambda *_: None)


def forget_passed_over_messages(patch: Patch) -> None:
    patch.setattr(joining, "on_listeners_added", lambda *_: None)


def leave_retried_tasks_unheld(patch: Patch) -> None:
    hold = Holds.hold

    def hold_less(
        holds: Holds, leader: Any, at: int, task: Any, moment: int, delay: float = 0
    ) -> None:
        if moment != START_HANDLING:
            hold(holds, leader, at, task, moment, delay)

    patch.setattr(Holds, "hold", hold_less)


@pytest.mark.parametrize(
    ("mistake", "transcript", "what"),
    [
        (
            skip_waiting_messages,
            "taps_late_and_queued_messages",
            "move {3} continued, but wiretap {5} (check before handling) was not fired",
        ),
        (
            skip_waiting_messages,
            "taps_late_and_locked_or_suspended_messages",
            "move {2} continued, but wiretap {4} (check before handling) was not fired",
        ),
        (
            forget_passed_over_messages,
            "taps_whose_listener_is_handled_late",
            "move {2} continued, but wiretap {3} (check before handling) was passed over, though its listener has a handler",
        ),
        (
            leave_retried_tasks_unheld,
            "taps_late_and_messages_handled_again",
            "move {1} was given to a handler again before end handling of check {3}",
        ),
    ],
)
def test_skipped_wiretap_is_found(
    monkeypatch: Patch, mistake: Callable[[Patch], None], transcript: str, what: str
) -> None:
    mistake(monkeypatch)
    replayed = Transcript()
    replayed.player.check = False
    blocks = (TRANSCRIPTS / f"{transcript}.txt").read_text().strip().split("\n\n")[1:]
    for command in (
        blocks[0].split("\n----")[0].splitlines() + blocks[1].split("\n----")[0].splitlines()
    ):
        replayed.play(command)
    for block in blocks[2:]:
        for command in block.split("\n----")[0].splitlines():
            if command.startswith(("legs/1: reply", "module", "user: resume")):
                replayed.play(command)
    found = checked([OPENED, *replayed.player.entries])
    assert what in [one.what for one in found]
    assert {one.rule for one in found} == {rules.TAPPED.text}
