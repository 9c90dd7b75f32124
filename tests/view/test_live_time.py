"""Time continues between two messages of a live run. The test has a real browser and a real
central.
"""

import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Semaphore

import pytest
from playwright.sync_api import Page, expect
from processes import Central, central

from tca_module import Client, Command, Goal, Module, Task, connect
from view.conftest import OpenPage, until

pytestmark = pytest.mark.slow

WALK = Goal("walk", int)
MOVE = Command("move", int)


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Central]:
    with central(tmp_path, "--quiet") as running:
        yield running


@pytest.fixture
def user(daemon: Central) -> Iterator[Client]:
    with connect("user", daemon.address) as client:
        assert client.goal(WALK, 1).id  # the goal has no handler; its id shows that central has it
        yield client


def seconds(page: Page, what: str) -> float:
    return float(page.locator(what).first.inner_text().split()[0])


def shown(page: Page) -> tuple[str, str, str]:
    """Return the parts that move: the clock, the duration of the wait, and the end of the chart."""
    return (
        page.locator("#clock").inner_text(),
        page.locator(".row .age").inner_text(),
        page.evaluate("tca.chart.window[1]"),
    )


def entries(page: Page) -> int:
    return int(page.evaluate("tca.store.times.length"))


def test_waits_and_chart_grow_without_new_facts(
    open_page: OpenPage, daemon: Central, user: Client
) -> None:
    page = open_page(daemon.journal)
    expect(page.locator(".row .why")).to_contain_text("for a module that handles walk, for ")
    page.locator(".row").click()
    expect(page.locator("#task .lead .age")).to_have_count(1)
    known, (clock, waited, end) = entries(page), shown(page)
    inside = page.locator("#task .lead .age").inner_text()
    expect(page.locator("#clock")).not_to_have_text(clock)
    expect(page.locator(".row .age")).not_to_have_text(waited)
    expect(page.locator("#task .lead .age")).not_to_have_text(inside)
    until(page, "(end) => tca.chart.window[1] > end", end)
    assert seconds(page, "#clock") > page.evaluate("tca.store.last")
    assert entries(page) == known  # no new entries
    user.goal(WALK, 2)
    expect(page.locator(".row")).to_have_count(2)
    assert page.evaluate("tca.store.times.at(-1)") > float(
        clock.split()[0]
    )  # the page's clock is central's

    page.keyboard.press("ArrowLeft")  # a view of the past does not move
    expect(page.locator("#follow")).not_to_have_class("on")
    expect(page.locator(".row")).to_have_count(1)
    there, known = page.locator("#clock").inner_text(), entries(page)
    user.goal(WALK, 3)
    until(page, f"tca.store.times.length > {known} && tca.chart.time < tca.store.last")
    assert page.locator("#clock").inner_text() == there
    for _ in range(3):  # beyond the last message
        page.keyboard.press("ArrowRight")
    expect(page.locator(".row")).to_have_count(3)
    expect(page.locator("#follow")).to_have_class("on")
    expect(page.locator("#clock")).not_to_have_text(there)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("how", "state"),
    [(signal.SIGTERM, "ended"), pytest.param(signal.SIGKILL, "not closed", marks=pytest.mark.soak)],
)
def test_ended_run_stands_still(
    open_page: OpenPage, daemon: Central, user: Client, how: int, state: str
) -> None:
    page = open_page(daemon.journal)
    expect(page.locator("#status")).to_have_text("live")
    daemon.signal(signal.Signals(how))
    expect(page.locator("#status")).to_have_text(state)
    until(page, "tca.chart.time === tca.store.last")
    assert seconds(page, "#clock") == pytest.approx(page.evaluate("tca.store.last"), abs=0.001)
    assert not page.evaluate("tca.store.isLive")


@pytest.mark.soak
def test_hidden_tab_stands_still(open_page: OpenPage, daemon: Central, user: Client) -> None:
    page = open_page(daemon.journal, clock=True)  # the test moves its time
    page.clock.run_for(1000)
    expect(page.locator(".row .age")).to_have_count(1)
    page.evaluate(
        "Object.defineProperty(document, 'hidden', { get: () => window.unseen, configurable: true })"
    )
    page.evaluate("window.unseen = true")
    before = shown(page)
    page.clock.run_for(4000)
    assert shown(page) == before
    page.evaluate("window.unseen = false; document.dispatchEvent(new Event('visibilitychange'))")
    page.clock.run_for(1000)
    after = shown(page)
    assert all(new != old for new, old in zip(after, before, strict=True))


@pytest.mark.soak
def test_page_stands_still_when_the_server_is_gone(
    open_page: OpenPage, daemon: Central, user: Client
) -> None:
    page = open_page(daemon.journal)
    reason = page.locator(".row[data-task='1'] .why")
    expect(reason).to_contain_text("for a module that handles walk, for ")
    page.route("**/api/notes*", lambda _route: None)  # no more notes
    with page.expect_request("**/api/notes*"):
        user.goal(WALK, 2)
        expect(page.locator(".row")).to_have_count(2)
    expect(reason).to_contain_text("for a module that handles walk, for ")  # unchanged
    expect(page.locator("#status")).to_have_text("live")
    page.route("**/api/frame*", lambda route: route.fulfill(json={}))  # an answer without a meaning
    user.goal(WALK, 3)  # the last answer that the page waits for
    expect(page.locator("#status")).to_have_text("no answer")
    assert not page.evaluate("tca.store.isLive")
    expect(reason).to_contain_text("for a module that handles walk, for ")
    page.unroute("**/api/frame*")
    expect(page.locator("#status")).to_have_text("live")
    assert page.evaluate("tca.store.isLive")


def test_chosen_row_stays_in_place_when_rows_arrive_above(
    open_page: OpenPage, daemon: Central, user: Client
) -> None:
    go_on, legs = Semaphore(0), Module("legs", daemon.address)

    @legs.handles(WALK)
    def walk(task: Task, _steps: int) -> None:
        for number in range(20):
            go_on.acquire()
            task.command(MOVE, number)

    moves = [user.command(MOVE, number) for number in range(22)]
    with legs.running(), ExitStack() as at_last:
        at_last.callback(go_on.release, 20)  # the handler ends even if the test fails
        page = open_page(daemon.journal, f"#task={moves[12].id}")
        expect(page.locator(".row.chosen")).to_be_visible()
        until(page, has_rows(23))
        page.locator("#rows").evaluate("(rows) => { rows.scrollTop = 48; }")
        before = top_of(page, ".row.chosen")
        go_on.release(10)
        until(page, has_rows(33))
        assert top_of(page, ".row.chosen") == before
        page.locator("#rows").evaluate(
            "(rows) => { rows.scrollTop = 16 * 24; }"
        )  # scrolled elsewhere
        seen = f".row[data-task='{moves[6].id}']"
        until(page, f'!!document.querySelector("{seen}")')
        before = top_of(page, seen)
        go_on.release(10)
        until(page, has_rows(43))
        assert top_of(page, seen) == before


def has_rows(number: int) -> str:
    return f"tca.tree.rows.length === {number}"


def top_of(page: Page, row: str) -> float:
    """Return the place of a row on the screen. It is read in one step, because each message
    replaces the rows.
    """
    return float(page.evaluate(f'document.querySelector("{row}").getBoundingClientRect().top'))
