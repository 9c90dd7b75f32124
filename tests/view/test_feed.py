"""The columns of a page agree with the history, however they are cut into frames."""

from collections import Counter
from math import inf, nextafter
from operator import itemgetter
from typing import Any

import pytest
from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation
from tools.story import Story, stumbling, walking

from tca_central.events import Effect, Record
from tca_tools.gantt.build import chart
from tca_tools.gantt.looks import dark
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import WATCHING, run_continued, run_continued_after
from tca_tools.journal.fold import History
from tca_tools.journal.outcomes import outcome_of
from tca_tools.journal.records import OVER, Message, TaskState
from tca_tools.view import verdicts
from tca_tools.view.feed import LANES_OF, TABLES, Feed, SpanKind
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome
from view.frames import parsed


class Page:
    """The columns that a page collects from frames."""

    def __init__(self) -> None:
        self.lengths: dict[str, int] = {}
        self.texts: list[str] = []
        self.columns: dict[str, list[Any]] = {}

    def receive(self, feed: Feed) -> None:
        head, columns = parsed(feed.columns.frame(self.lengths, {}))
        self.lengths = head["lengths"]
        self.texts += head["texts"]
        for name, added in columns.items():
            table, _, column = name.partition(".")
            is_text = f"{column}:t" in TABLES[table].split()
            self.columns.setdefault(name, []).extend(
                self.texts[one] if is_text else one for one in added
            )

    def table(self, name: str) -> list[tuple[Any, ...]]:
        return list(
            zip(
                *(column for full, column in self.columns.items() if full.startswith(f"{name}.")),
                strict=True,
            )
        )

    def states(self, time: float) -> dict[int, str]:
        return {task: state for task, since, state in self.table("state") if since <= time}


class FedPlayer(Player):
    """A player that feeds all its entries. The page asks for news after every seventh entry."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.feed, self.page, self.entries = Feed(), Page(), list[Entry]()

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        for effect in effects:
            if isinstance(effect, Record):
                self.feed.apply(effect.entry)
                self.entries.append(effect.entry)
                if len(self.entries) % 7 == 0:
                    self.page.receive(self.feed)
        return effects


@given(st.lists(operation, max_size=60))
@settings(max_examples=40)
def test_following_page_knows_all_of_the_history(
    operations: list[tuple[str, int, int, int, int]],
) -> None:
    player = FedPlayer()
    life = Life(player)
    for name, *numbers in operations:
        life.do(name, *numbers)
    page, history = player.page, player.feed.history
    page.receive(player.feed)
    assert page.columns["entry.time"] == list(history.times)
    assert page.columns["task.id"] == list(history.tasks)
    others = [one for one in history.messages.values() if one.id not in history.tasks]
    message_rows = page.table("message")
    assert message_rows == [(one.id, one.name, one.received) for one in others]
    for time in history.times[::5]:
        assert page.states(time) == {
            task.id: WATCHING if task.is_watching else task.state
            for task in RunAt(history, time).tasks.values()
        }
    spans, ends = (
        page.table("span"),
        {span: (time, outcome) for span, time, outcome in page.table("end")},
    )
    assert len(ends) == len(page.table("end"))
    handled = [
        (message, start, *ends.get(number, (None, "")))
        for number, (_, kind, _, message, _, _, start) in enumerate(spans)
        if kind == SpanKind.HANDLING
    ]
    known = [(run.message_id, run.start, run.end, run.outcome or "") for run in history.handlings]
    assert sorted(handled, key=str) == sorted(known, key=str)
    queued = sum(kind == SpanKind.QUEUED for _, kind, *_ in spans)
    assert queued == len(history.queueings)
    assert sum(kind == SpanKind.HELD for _, kind, *_ in spans) == sum(
        map(len, history.grants.values())
    )
    assert_lanes(spans, ends)
    assert_verdicts(page, history, player.entries)
    assert_traffic(page, history)
    tops = [
        one for one in history.tasks.values() if not one.parent and not one.message_class.is_monitor
    ]
    ended = [one.state if one.state in OVER else TaskState.ACHIEVING for one in tops]
    assert outcome_of(player.entries).top == Counter(ended)
    whole = Page()
    whole.receive(player.feed)
    assert (whole.columns, whole.texts) == (page.columns, page.texts)


def assert_lanes(spans: list[tuple[Any, ...]], ends: dict[int, tuple[float, str]]) -> None:
    """Assert that no two spans of a lane overlap, and that there are no more lanes than
    simultaneous spans.
    """
    rows: dict[tuple[int, str], list[tuple[float, float, int]]] = {}
    for number, (row, kind, _, _, within, lane, start) in enumerate(spans):
        if within < 0 and kind in LANES_OF:
            end, _ = ends.get(number, (inf, ""))
            rows.setdefault((row, LANES_OF[kind]), []).append((start, end, lane))
    for bars in rows.values():
        lanes: dict[int, float] = {}
        for start, end, lane in sorted(bars, key=itemgetter(0)):
            assert lanes.get(lane, 0.0) <= start
            lanes[lane] = end
        most = max(sum(begun <= start <= over for begun, over, _ in bars) for start, _, _ in bars)
        assert len(lanes) <= most


def assert_traffic(page: Page, history: History) -> None:
    """Assert that each handling counts once, and each message that waits for its first handling."""
    links, counted = page.table("link"), Counter[tuple[str, str, str]]()
    for link, _, is_less in page.table("sent"):
        sender, message, _, handler = links[link]
        counted[sender, message, handler] += -1 if is_less else 1
    known = Counter[tuple[str, str, str]]()
    for run in history.handlings:
        if (message := history.messages.get(run.message_id)) is not None:
            known[message.sender, run.name, run.module] += 1
    for message in history.messages.values():
        kind = message.message_class
        if not (message.handlings or kind.fans_out or kind.is_monitor):
            known[message.sender, message.name, ""] += 1
    assert +counted == known


def assert_verdicts(page: Page, history: History, entries: list[Entry]) -> None:
    """Assert that each failure has a row, and that its last verdict agrees with the history."""
    last = {row: is_good for row, is_good, _ in page.table("verdict")}
    failures = page.table("failure")
    for row, is_good, turn in page.table("verdict"):  # each verdict as known at its time
        message, time, *_ = failures[row]
        if message in history.messages:
            assert is_good == run_continued(history, history.messages[message], time, turn)
            assert is_good != (
                turn > time
                and run_continued(history, history.messages[message], time, nextafter(turn, 0.0))
            )
    reported = {
        (message, time, last.get(row, 0))
        for row, (message, time, *_) in enumerate(page.table("failure"))
    }
    raised = {
        (entry.time, fact.id)
        for entry in entries
        for fact in entry.facts
        if isinstance(fact, facts.Failed)
    }
    assert len(raised) <= len(page.table("failure"))
    for message, time, is_good in reported:
        if message in history.messages:
            assert is_good == run_continued(history, history.messages[message], time)
    ended = [
        (row, span)
        for row, (*_, span, is_beside) in enumerate(page.table("failure"))
        if span >= 0 and not is_beside
    ]
    spans = {span: last.get(row, 0) for row, span in ended}
    bad = [run for run in history.handlings if run.outcome is Outcome.FAILED]
    assert sorted(spans.values()) == sorted(run_continued_after(history, run) for run in bad)


def test_walk_has_the_expected_columns() -> None:
    feed, page = Feed(), Page()
    for entry in stumbling().entries:
        feed.apply(entry)
    page.receive(feed)
    labels = [label for label, _ in page.table("row")]
    assert labels == ["user interface", "gait planner", "perception", "controller"]
    moves = [
        (name, number)
        for number, (_, kind, name, *_) in enumerate(page.table("span"))
        if kind == SpanKind.HANDLING and name.startswith("move")
    ]
    assert [name for name, _ in moves] == ["move leg", "move body"]
    ends = {span: (time, outcome) for span, time, outcome in page.table("end")}
    assert [ends[span] for _, span in moves] == [(3.4, Outcome.DONE), (4.5, Outcome.FAILED)]
    (wait,) = [row for row in page.table("span") if row[1] == SpanKind.WAITING and row[3] == 5]
    assert page.table("span")[wait[4]][2] == "take steps"  # the handling around it
    holds = {(task, before, kind) for task, before, kind, _ in page.table("hold")}
    assert {
        (3, 2, "SEQ"),
        (4, 3, "SEQ"),
        (4, 3, "plan ahead"),
        (7, 6, "SEQ"),
        (10, 9, "SEQ"),
    } == holds


def test_idle_module_has_a_row() -> None:
    story = Story().module("user").module("lamp", "shine", resource="bulb").at(1.0)
    story.say(facts.ModuleLeft("lamp", "its process ended")).at(2.0).module(
        "lamp", "shine", resource="bulb"
    )
    feed, page = Feed(), Page()
    for entry in story.entries:
        feed.apply(entry)
    page.receive(feed)
    rows = [label for label, _ in page.table("row")]
    spans = [(rows[row], kind, start) for row, kind, *_, start in page.table("span")]
    assert spans == [
        ("lamp / bulb", SpanKind.CONNECTED, 0.0),
        ("lamp / bulb", SpanKind.CONNECTED, 2.0),
    ]
    assert page.table("end") == [(0, 1.0, "")]


def test_monitor_stops_watching_while_its_action_runs() -> None:
    story = Story().module("eyes", "look").module("arm", "lift").at(1.0)
    monitor = story.received("look", MessageClass.POINT_MONITOR, "user")
    story.reached(monitor, Moment.START_PLANNING, Moment.END_PLANNING)
    story.reached(monitor, Moment.START_HANDLING, Moment.START_ACHIEVING).at(2.0)
    lift = story.command("lift", "central", monitor)
    story.say(facts.MonitorEnded(TaskId(monitor), "it has been tested")).delivered(lift, "arm")
    feed, page = Feed(), Page()
    for entry in story.entries:
        feed.apply(entry)
    page.receive(feed)
    assert [(time, state) for task, time, state in page.table("state") if task == monitor] == [
        (1.0, WATCHING),
        (2.0, TaskState.ACHIEVING),
    ]


def test_feed_sends_an_empty_frame_when_nothing_changed() -> None:
    feed, page = Feed(), Page()
    for entry in walking().entries:
        feed.apply(entry)
    page.receive(feed)
    _, columns = parsed(feed.columns.frame(page.lengths, {}))
    assert not any(columns.values())


def test_feed_reports_each_failure_with_its_message() -> None:
    story = Story().module("legs", "move").at(1.0)
    move = story.command("move", "user")
    story.say(facts.Delivered(77, move, "legs", "legs")).at(2.0).say(
        facts.Failed(77, "lost", "its module left")
    )
    story.at(3.0).say(facts.Failed(move, "slip", ""), facts.Failed(99, "nobody knows", ""))
    feed, page = Feed(), Page()
    for entry in story.entries:
        feed.apply(entry)
    page.receive(feed)
    assert page.table("failure") == [
        (move, 2.0, 1, 0),
        (move, 3.0, -1, 0),
        (99, 3.0, -1, 0),
    ]


def test_feed_uses_the_colours_of_other_charts() -> None:
    story = walking()
    feed = Feed()
    for entry in story.entries:
        feed.apply(entry)
    names = chart(feed.history).names
    assert feed.colours() == {name: dark(number) for number, name in enumerate(names)}


def test_verdict_is_sent_when_it_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Many steps of a walk fail and are killed. Only the walk's end changes their verdicts."""
    asked: list[float] = []

    def counted(run: History, failed: Message, time: float) -> bool:
        asked.append(time)
        return run_continued(run, failed, time)

    monkeypatch.setattr(verdicts, "run_continued", counted)
    story = Story().module("legs", "step").at(1.0)
    walk = story.goal("walk", "user")
    for number in range(50):
        step = story.command("step", "user", walk)
        story.at(2.0 + number).delivered(step, "legs").returned(step, Outcome.FAILED).say(
            facts.Failed(step, "slip", "")
        )
        story.say(facts.Killed(TaskId(step), "slipped", "user")).reached(step, *Moment)
    story.at(60.0)
    for _ in range(500):
        story.acted(story.command("step", "user"), "legs", 0.1)
    feed, page = Feed(), Page()
    for entry in story.entries:
        feed.apply(entry)
    page.receive(feed)
    assert len(asked) <= 3 * 50
    assert page.table("verdict") == []
    for entry in story.at(200.0).reached(walk, *Moment).entries[-1:]:
        feed.apply(entry)
    page.receive(feed)
    assert page.table("verdict") == [(row, True, 200.0) for row in range(50)]


def test_page_counts_the_standbys_that_can_take_over() -> None:
    feed, page = Feed(), Page()
    feed.apply(Entry(1, 2.0, [facts.MembersChanged("one:5", ["two:7", "three:8"], ["three:8"])]))
    page.receive(feed)
    ((time, text, standbys),) = page.table("members")
    assert (time, standbys) == (2.0, 1)
    assert "one:5" in text
