"""How many wait at most: the page's chart says of a run what `tca gantt` says of it, however brief that was."""

import random
import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from tools.story import Story, walking
from view.conftest import Look, until, written

from tca_tools.gantt.bars import chart
from tca_tools.gantt.blocks import _longest_queue
from tca_tools.gantt.parts import Bar
from tca_tools.gantt.svg import svg_text
from tca_wire.journal import facts

pytestmark = pytest.mark.slow

NOW = 60
PEAKS = """async ([frames, asked]) => {
  const { Lanes } = await import("/page/lanes.js"), lanes = new Lanes(), spans = new Map();
  for (const { begun, ended } of frames) {
    for (const [number, end] of ended) {
      if (!spans.has(number)) continue;
      spans.get(number).end = end;
      lanes.ended(spans.get(number));
    }
    for (const [number, start, end] of begun) {
      spans.set(number, { start, end: end ?? Infinity });
      lanes.put(spans.get(number));
    }
    lanes.most(0, 1); // somebody looks meanwhile
  }
  return asked.map(([from, until]) => lanes.most(from, until));
}"""
"""The most at a time between some times, of spans that came in frames: what has ended meanwhile comes with its end."""


def random_bars(life: random.Random) -> list[Bar]:
    """Many begin or end together, some have no length, some go on."""
    starts = sorted(life.randint(0, NOW) for _ in range(life.choice([5, 40, 600])))
    ends = [min(start + life.choice([0, 0, 1, 2, 5, 20, NOW]), NOW) for start in starts]
    return [Bar("move", str, start, end, end == NOW) for start, end in zip(starts, ends, strict=True)]


def in_frames(bars: list[Bar], looks: list[float]) -> list[dict[str, object]]:
    """What a page is told when it looks at these times."""
    frames: list[dict[str, object]] = []
    for last, now in zip([-1.0, *looks], [*looks, NOW], strict=True):
        new = [(number, bar) for number, bar in enumerate(bars) if last < bar.start <= now]
        begun = [(number, bar.start, None if bar.is_open or bar.end > now else bar.end) for number, bar in new]
        over = [(number, bar) for number, bar in enumerate(bars) if bar.start <= last < bar.end <= now]
        frames.append({"begun": begun, "ended": [(number, bar.end) for number, bar in over if not bar.is_open]})
    return frames


def test_the_page_counts_as_other_charts_do(look: Look, tmp_path: Path) -> None:
    page, life = look(walking().write(tmp_path / "walk")), random.Random(3)
    for _ in range(40):
        bars = random_bars(life)
        looks = sorted(life.randint(0, NOW) for _ in range(life.randint(0, 6)))
        asked = [(0, NOW), *(sorted((life.uniform(0, NOW), life.uniform(0, NOW))) for _ in range(20))]
        steps = _longest_queue(bars)
        most = [
            max((number for start, end, number in steps if start < until and end > from_), default=0)
            for from_, until in asked
        ]
        assert page.evaluate(PEAKS, [in_frames(bars, [*map(float, looks)]), asked]) == most


def bursts() -> Story:
    """Three times many messages come at once, and are handled soon, in a run of twenty minutes; a few are suspended."""
    story = Story()
    for module, number, begin in (("sink", 298, 301.0), ("farm", 14, 640.7), ("shop", 4, 900.2), ("desk", 1, 950.0)):
        story.at(1.0).module(module, f"note {module}")
        for size, time in ((number, begin), (number // 2, begin + 100)):
            waiting = [story.at(time).command(f"note {module}", "user") for _ in range(size)]
            for task in waiting:
                story.queued(task, module)
            for place, task in enumerate(waiting):
                story.at(time + 0.1 + place * 1e-3).delivered(task, module).returned(task)
    return story.at(1200.0).acted(story.command("note desk", "user"), "desk", 1201.0).say(facts.Closed("done"))


def numbers(page: Page) -> list[str]:
    return [text for text, _ in written(page) if text.startswith("up to")]


def numbers_on(page: Page, width: int) -> list[str]:
    page.set_viewport_size({"width": width, "height": 1200})
    until(page, f"() => tca.chart.width > {width - 20} && tca.chart.width <= {width}")
    return numbers(page)


def test_numbers_of_the_whole_run_are_those_of_tca_gantt_and_of_a_part_those_of_that(
    look: Look, tmp_path: Path
) -> None:
    story = bursts()
    page = look(story.write(tmp_path / "bursts"))
    expect(page.locator("#status")).to_have_text("ended")
    picture = re.findall(r"up to \d+ queued", svg_text(chart(story.fold()), "bursts"))
    assert picture == ["up to 298 queued", "up to 14 queued", "up to 4 queued"]
    for width in (1400, 1391, 1000, 700):
        assert numbers_on(page, width) == picture
    page.evaluate("Object.assign(tca.chart, { from: 350, to: 800 })")
    assert numbers(page) == ["up to 149 queued", "up to 14 queued"]
