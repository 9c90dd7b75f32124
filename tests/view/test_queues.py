"""Queues in the page's chart: their layout and numbers are those of `tca gantt`, even for long
queues.
"""

import itertools
import random
import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect
from tools.story import Story

from tca_tools.gantt.build import chart
from tca_tools.gantt.svg import svg_text
from tca_wire.journal import facts
from view.conftest import OpenPage, until, written

pytestmark = pytest.mark.slow


def queue_of(number: int) -> Story:
    """Return a story of a handled command. Each second, one more command is queued for its
    resource.
    """
    story = Story().module("legs", "move").at(1.0)
    story.delivered(story.command("move", "user"), "legs")
    for second in range(2, number + 2):
        story.at(second).queued(story.command("move", "user"), "legs")
    return story


@pytest.mark.soak
@pytest.mark.parametrize("number", [3_000, pytest.param(100_000, marks=pytest.mark.soak)])
def test_long_queue_is_shown_at_any_time(open_page: OpenPage, tmp_path: Path, number: int) -> None:
    log = tmp_path / "long.tcaj"
    log.write_bytes(queue_of(number).encoded())
    page = open_page(log)
    expect(page.locator("#counts")).to_contain_text(f"{number} queued")
    expect(page.locator(".row").last).to_contain_text("for legs, busy with move {1}")
    slider = page.locator("#slider").bounding_box()
    assert slider
    page.locator("#slider").click(position={"x": slider["width"] / 2, "y": slider["height"] / 2})
    until(page, "(half) => Math.abs(tca.tree.time - half) < half / 100", number / 2)
    expect(page.locator("#counts")).to_contain_text(
        f"{page.evaluate('Math.floor(tca.tree.time)') - 1} queued"
    )
    page.locator("#search").fill(f"{number // 4}")
    page.keyboard.press("Enter")
    expect(page.locator("#task h2")).to_have_text(f"move {{{number // 4}}}")
    expect(page.locator("#task")).to_contain_text("queued for legs, busy with move {1}")
    assert page.locator(".row").count() < 100  # only visible rows
    [row] = page.evaluate(
        "tca.chart.layout.map(({ row, top, bottom }) => [row.label, row.queued.length, bottom - top])"
    )
    assert row[:2] == ["legs", number]
    assert row[2] < 200  # pixels


def lanes_on(page: Page, label: str) -> Any:
    """Return the lanes of the queued messages of a row."""
    return page.evaluate(
        """(label) => tca.chart.layout.find(({ row }) => row.label === label).row.queued.lists
          .flat().map((span) => [span.message, span.lane]).sort((a, b) => a[0] - b[0])""",
        label,
    )


@pytest.mark.soak
def test_refilled_queue_has_the_layout_of_other_charts(open_page: OpenPage, tmp_path: Path) -> None:
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
    page = open_page(story.at(130.0).say(facts.Closed("done")).write(tmp_path / "queue"))
    expect(page.locator("#counts")).to_be_attached()
    [row] = chart(story.fold()).rows
    counted = page.evaluate(
        """() => tca.chart.layout.find(({ row }) => row.label === "legs").row.queued.peaks(
          Array.from({ length: 240 }, (_, place) => Math.floor(place / 2) + 0.25 + (place % 2) * 0.01)).filter((_, place) => place % 2 === 0)"""
    )
    bars = [
        sum(bar.start <= second + 0.25 < bar.end for bar in row.queued) for second in range(120)
    ]
    assert counted == bars
    assert max(bars) > 12
    by_start = sorted(row.queued, key=lambda bar: bar.start)
    assert [lane for _, lane in lanes_on(page, "legs")] == [bar.lane for bar in by_start]
    assert_queue_peaks(page)


NOW = 60
PEAKS = """async ([begun, ended, times]) => {
  const { newRow } = await import("/page/rows.js"), { queued } = newRow("", "");
  for (const start of begun) queued.put({ start, lane: 0 });
  for (const end of ended) queued.end({ end });
  return queued.peaks(times);
}"""
"""JavaScript: the greatest queue length between each two times."""


def assert_queue_peaks(page: Page) -> None:
    """Compare peaks with a count. Many bars begin or end together, some have no length, and some
    stay open.
    """
    life = random.Random(3)
    for _ in range(20):
        starts = sorted(life.randint(0, NOW) for _ in range(life.choice([5, 40, 600])))
        bars = [(start, start + life.choice([0, 0, 1, 2, 5, 20, NOW])) for start in starts]
        times = sorted(
            [
                0.0,
                NOW,
                *(life.choice([life.uniform(0, NOW), life.randint(0, NOW)]) for _ in range(20)),
            ]
        )
        most = []
        for since, last in itertools.pairwise(times):
            looks = (
                [since, *(start for start in starts if since < start < last)]
                if since < last
                else []
            )
            most.append(
                max((sum(start <= at < end for start, end in bars) for at in looks), default=0)
            )
        ended = sorted(end for _, end in bars if end <= NOW)
        assert page.evaluate(PEAKS, [starts, ended, times]) == most


def bursts() -> Story:
    """Return a run of twenty minutes with bursts of messages at four modules. The messages are soon
    handled.
    """
    story = Story()
    for module, number, begin in (
        ("sink", 298, 301.0),
        ("farm", 14, 640.7),
        ("shop", 4, 900.2),
        ("desk", 1, 950.0),
    ):
        story.at(1.0).module(module, f"note {module}")
        for size, time in ((number, begin), (number // 2, begin + 100)):
            waiting = [story.at(time).command(f"note {module}", "user") for _ in range(size)]
            for task in waiting:
                story.queued(task, module)
            for place, task in enumerate(waiting):
                story.at(time + 0.1 + place * 1e-3).delivered(task, module).returned(task)
    return (
        story.at(1200.0)
        .acted(story.command("note desk", "user"), "desk", 1201.0)
        .say(facts.Closed("done"))
    )


def queue_numbers(page: Page) -> list[str]:
    return [text for text, _ in written(page) if text.startswith("up to")]


def queue_numbers_at_width(page: Page, width: int) -> list[str]:
    page.set_viewport_size({"width": width, "height": 1200})
    until(page, f"() => tca.chart.width > {width - 20} && tca.chart.width <= {width}")
    return queue_numbers(page)


def test_figures_match_tca_gantt_for_whole_and_part(open_page: OpenPage, tmp_path: Path) -> None:
    story = bursts()
    page = open_page(story.write(tmp_path / "bursts"))
    expect(page.locator("#status")).to_have_text("ended")
    picture = re.findall(r"up to \d+ queued", svg_text(chart(story.fold()), "bursts"))
    assert picture == ["up to 298 queued", "up to 14 queued", "up to 4 queued"]
    for width in (1391, 700):
        assert queue_numbers_at_width(page, width) == picture
    page.evaluate("Object.assign(tca.chart, { from: 350, to: 800 })")
    assert queue_numbers(page) == ["up to 149 queued", "up to 14 queued"]
