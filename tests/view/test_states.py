"""Requests to a task and its progress, on the page."""

from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import made

from view.conftest import OpenPage

pytestmark = pytest.mark.slow


def test_page_shows_requests_and_the_newest_progress(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("grasping").write(tmp_path / "grasp"), "#t=3.5&task=1")
    why = page.locator(".row[data-task='1'] .why")
    expect(why).to_have_text('update requested, progress: {"force": 1}')
    pane = page.locator("#task")
    expect(pane.locator("td", has_text="update requested, 3 changes")).to_be_visible()
    assert pane.locator("pre").all_inner_texts() == [
        '{"force": 1}',
        '{"width": 0.05}',
        '{"width": 0.1}',
    ]
    change = page.evaluate(
        "tca.store.rows.flatMap((row) => row.changes).map(({ time, span }) => [time, span.message])"
    )
    assert change == [[3, 1], [4, 1], [7, 1], [8, 1]]
    x, y = page.evaluate(
        """() => {
          const { chart } = tca, box = chart.canvas.getBoundingClientRect(), [row] = chart.layout, [from, to] = chart.window;
          return [box.left + chart.labelWidth + (3 - from) / (to - from) * (chart.width - chart.labelWidth), box.top + row.top + 8];
        }"""
    )
    page.mouse.move(x, y)
    expect(page.locator("#hint")).to_contain_text(
        "update by planner, now update requested: it is narrower"
    )
