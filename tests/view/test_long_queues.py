"""What waits by the thousand: its bars lie in lanes as in the other charts, and the page does not stand still for them."""

import math
import random
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest
from playwright.sync_api import Page, expect
from tools.story import Story, walking
from view.conftest import Look, until

from tca_tools.gantt.bars import _in_lanes as in_lanes
from tca_tools.gantt.bars import chart
from tca_tools.gantt.parts import Bar
from tca_tools.run.at_time import RunAt
from tca_tools.run.journals import Log, Place, open_log
from tca_tools.view import answers
from tca_tools.view.answers import causes_answer
from tca_tools.view.reading import Reading
from tca_tools.why.ends import causes
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import TaskId

pytestmark = pytest.mark.slow


def queue_of(number: int) -> Story:
    """A command that is handled, and others that wait for the same resource from one second after the other."""
    story = Story().module("legs", "move").at(1.0)
    story.delivered(story.command("move", "user"), "legs")
    for second in range(2, number + 2):
        story.at(second).queued(story.command("move", "user"), "legs")
    return story


@pytest.mark.parametrize("number", [10_000, pytest.param(100_000, marks=pytest.mark.soak)])
def test_a_long_queue_is_shown_at_any_moment(look: Look, tmp_path: Path, number: int) -> None:
    log = tmp_path / "long.tcaj"
    log.write_bytes(queue_of(number).encoded())
    page = look(log)
    expect(page.locator("#counts")).to_contain_text(f"{number} queued")
    expect(page.locator(".row").last).to_contain_text("waits for legs, busy with move {1}")
    slider = page.locator("#slider").bounding_box()
    assert slider
    page.locator("#slider").click(position={"x": slider["width"] / 2, "y": slider["height"] / 2})
    until(page, "(half) => Math.abs(tca.tree.time - half) < half / 100", number / 2)
    expect(page.locator("#counts")).to_contain_text(f"{page.evaluate('Math.floor(tca.tree.time)') - 1} queued")
    page.locator("#search").fill(f"{number // 4}")
    page.keyboard.press("Enter")
    expect(page.locator("#task h2")).to_have_text(f"move {{{number // 4}}}")
    expect(page.locator("#task")).to_contain_text("queued for legs, busy with move {1}")
    assert page.locator(".row").count() < 100  # only what is in sight
    [row] = page.evaluate(
        "tca.chart.layout.map(({ row, top, bottom }) => [row.label, row.queued.length, bottom - top])"
    )
    assert row[:2] == ["legs", number]
    assert row[2] < 200  # pixels


def test_a_lane_is_found_without_a_look_at_all_others(look: Look, tmp_path: Path) -> None:
    page = look(walking().write(tmp_path / "walk"))
    looks = """async ([number]) => {
      const { Lanes } = await import("/page/lanes.js"), lanes = new Lanes();
      let looks = 0, spans = [];
      for (let start = 0; start < number; start++) {
        spans.push({ start, until: Infinity, get end() { looks++; return this.until; } });
        lanes.put(spans.at(-1));
      }
      for (const span of spans) {
        span.until = number;
        lanes.ended(span);
      }
      lanes.put({ start: number, end: Infinity });
      return [looks, lanes.length, lanes.lists[0].length];
    }"""
    assert page.evaluate(looks, [10_000]) == [2 * 10_000, 10_000, 2]


PLACE = Place(Path("none"), 0)


class Watched(Reading):
    """Others look at it, or more is read, whenever that is possible."""

    def __init__(self, log: Log, entries: list[Entry], patch: pytest.MonkeyPatch) -> None:
        patch.setattr(answers, "_WHILE", 0.002)
        super().__init__(log)
        self.looks = 0
        self.entries_to_come = entries

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self.looks += 1
        if self.looks == 2 and self.entries_to_come:
            self._pending = [(entry, PLACE) for entry in self.entries_to_come]
            self._take()


@pytest.mark.parametrize("moment", [3000.0, 3900.0, math.inf])
@pytest.mark.parametrize("read_before", [3500, 4003])
def test_others_are_let_in_while_causes_are_looked_for(
    tmp_path: Path, moment: float, read_before: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What comes meanwhile is of later moments: the answer is of when it was asked for."""
    story = queue_of(4000)
    reading = Watched(open_log(story.write(tmp_path / "long")), story.entries[read_before:], monkeypatch)
    for entry in story.entries[:read_before]:
        reading.feed.apply(entry)
    asked = min(moment, reading.feed.history.time)
    answer = causes_answer(reading, moment)
    waiting, things, found = causes(RunAt(story.fold(), asked))
    assert answer == {"waiting": waiting, "things": things, "causes": [one._asdict() for one in found]}
    assert reading.looks >= 3


@pytest.mark.parametrize("later", [0, 5])
def test_more_of_the_entry_that_is_looked_at_counts(
    tmp_path: Path, later: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An event of very many facts has several records; between two of them a page may have asked."""
    story = queue_of(2000)
    last = story.entries[-1]
    more: list[facts.Fact] = [facts.SuspendedOrResumed(TaskId(5), is_suspended=True)]
    to_come = [Entry(last.number, last.time, more), *queue_of(2000 + later).entries[len(story.entries) :]]
    reading = Watched(open_log(story.write(tmp_path / "long")), to_come, monkeypatch)
    for entry in story.entries:
        reading.feed.apply(entry)
    answer = causes_answer(reading, last.time)
    last.facts.extend(more)
    waiting, things, found = causes(RunAt(story.fold(), last.time))
    assert answer == {"waiting": waiting, "things": things, "causes": [one._asdict() for one in found]}
    assert things == 2


def random_bars(life: random.Random) -> list[Bar]:
    """In the order in which they begin; some begin as others end, some have no length, some go on."""
    starts = sorted(life.randint(0, 40) for _ in range(60))
    ends = [start + life.choice([0, 1, 2, 5, 20, 1000]) for start in starts]
    return [Bar("move", str, start, end, end > 900) for start, end in zip(starts, ends, strict=True)]


LANES = """async ([bars, told]) => {
  const { Lanes } = await import("/page/lanes.js"), lanes = new Lanes(), open = [];
  return bars.map(([start, end], number) => {
    for (const one of open.filter((one) => one.last <= start && one.span.end === Infinity)) {
      one.span.end = one.last;
      lanes.ended(one.span);
    }
    const span = { start, end: told[number] ? end : Infinity };
    lanes.put(span);
    open.push({ span, last: end });
    return span.lane;
  });
}"""
"""The lanes of bars; the ends of some are known as they begin, of others when they come."""


def test_bars_lie_in_the_same_lanes_as_in_other_charts(look: Look, tmp_path: Path) -> None:
    page, life = look(walking().write(tmp_path / "walk")), random.Random(0)
    for _ in range(20):
        bars = random_bars(life)
        told = [life.random() < 0.3 for _ in bars]
        found = page.evaluate(LANES, [[(bar.start, bar.end) for bar in bars], told])
        assert found == [bar.lane for bar in in_lanes(bars, 0, 2000)]
        assert len(set(found)) > 5


def lanes_on(page: Page, label: str) -> Any:
    """By message, on the page."""
    return page.evaluate(
        """(label) => tca.chart.layout.find(({ row }) => row.label === label).row.queued.lists
          .flat().map((span) => [span.message, span.lane]).sort((a, b) => a[0] - b[0])""",
        label,
    )


def test_a_queue_that_empties_and_fills_again_lies_as_in_other_charts(look: Look, tmp_path: Path) -> None:
    story, life = Story().module("legs", "move"), random.Random(1)
    waiting: list[int] = []
    for second in range(1, 120):
        story.at(second)
        if waiting and life.random() < 0.45:
            task = waiting.pop(life.randrange(len(waiting)))
            story.delivered(task, "legs").at(second + 0.5).returned(task)
        else:
            waiting.append(story.command("move", "user"))
            story.queued(waiting[-1], "legs")
    page = look(story.at(130.0).say(facts.Closed("done")).write(tmp_path / "queue"))
    expect(page.locator("#counts")).to_be_attached()
    [row] = chart(story.fold()).rows
    counted = page.evaluate(
        """() => Array.from({ length: 120 }, (_, second) =>
          tca.chart.layout.find(({ row }) => row.label === "legs").row.queued.count(second + 0.25))"""
    )
    bars = [sum(bar.start <= second + 0.25 < bar.end for bar in row.queued) for second in range(120)]
    assert counted == bars
    assert max(bars) > 12
    by_start = sorted(row.queued, key=lambda bar: bar.start)
    assert [lane for _, lane in lanes_on(page, "legs")] == [bar.lane for bar in by_start]
