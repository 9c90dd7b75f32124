"""The run that the page shows: the newest run or a chosen one. Real centrals run one after the
other.
"""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from processes import Central, central
from tools.story import stumbling, walking

from tca_module import Goal, connect
from tca_wire.endpoint import default_journals
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION
from view.conftest import OpenPage

pytestmark = pytest.mark.slow

WALK, REST = Goal("walk", int), Goal("rest", int)
Start = Callable[[str, Goal[int]], Central]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Yield a function that starts a central with a name, and sends it a goal without a handler."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with ExitStack() as running:

        def begin(name: str, goal: Goal[int]) -> Central:
            (tmp_path / name).mkdir(exist_ok=True)
            started = running.enter_context(central(tmp_path / name, "--fresh"))
            with connect("user", started.address) as user:
                user.goal(goal, 1)
            return started

        yield begin


def expect_task(page: Page, name: str) -> None:
    expect(page.locator(".row .name")).to_have_text([name])


def test_live_page_moves_to_the_run_of_a_restarted_central(
    open_page: OpenPage, serve: Callable[..., str], start: Start
) -> None:
    first = start("first", WALK)
    page = open_page(serve())
    expect_task(page, "walk")
    first.stop()
    expect(page.locator("#status")).to_have_text("ended")
    second = start("second", REST)
    expect_task(page, "rest")
    expect(page.locator("#status")).to_have_text("live")
    expect(page.locator("#newer")).to_be_hidden()
    expect(page.locator("#over")).to_contain_text("A new run has started, and is shown now: ")
    expect(page.locator("#over")).to_contain_text(", started ")
    page.locator("#over button").first.click()  # the way back
    expect_task(page, "walk")
    expect(page.locator("#over")).to_be_hidden()
    page.go_back()
    expect_task(page, "rest")
    expect(page.locator("#over")).to_be_hidden()
    expect(page.locator("#runs option")).to_have_count(2)
    page.locator("#runs").select_option(index=1)
    expect_task(page, "walk")
    second.stop()
    start("third", Goal("sleep", int))
    expect(page.locator("#runs option")).to_have_count(3)
    expect_task(page, "walk")  # a chosen run stays
    expect(page.locator("#newer")).to_be_visible()


@pytest.mark.soak
def test_note_links_to_the_newer_run(
    open_page: OpenPage, serve: Callable[..., str], start: Start
) -> None:
    first = start("first", WALK)
    page = open_page(serve())
    expect_task(page, "walk")
    page.keyboard.press("Home")
    first.stop()
    start("second", REST)
    page.locator("#newer button").click()
    expect_task(page, "rest")


def restart_after_a_kill(first: Central, start: Start) -> None:
    first.kill()
    start("arm", REST)


@pytest.mark.soak
def test_chooser_names_the_shown_run_when_a_newer_exists(
    open_page: OpenPage, serve: Callable[..., str], start: Start
) -> None:
    first = start("arm", WALK)
    page = open_page(serve())
    page.locator(".row").click()
    expect(page.locator("#name")).to_have_text("arm/journal")
    restart_after_a_kill(first, start)
    chosen = page.locator("#runs option:checked")
    expect(page.locator("#newer")).to_contain_text("a newer run has started: arm/journal#2 ")
    expect(page.locator("#runs option")).to_have_text(["arm/journal#2 (newest)", "arm/journal#1"])
    expect(chosen).to_have_text("arm/journal#1")
    expect(page).to_have_title("arm/journal#1 – tca view")
    page.reload()
    expect(page.locator("#task h2")).to_have_text("walk {1}")
    expect(chosen).to_have_text("arm/journal#1")
    page.evaluate("location.hash = ''")
    page.locator("#runs").select_option(label="arm/journal#2 (newest)")
    expect_task(page, "rest")
    expect(chosen).to_have_text("arm/journal#2 (newest)")
    expect(page).to_have_url(re.compile(r"/$"))


@pytest.mark.soak
def test_back_button_returns_to_a_run_in_the_same_folder(
    open_page: OpenPage, serve: Callable[..., str], start: Start
) -> None:
    first = start("arm", WALK)
    page = open_page(serve())
    expect_task(page, "walk")
    restart_after_a_kill(first, start)
    expect_task(page, "rest")
    expect(page.locator("#over")).to_contain_text("is shown now: arm/journal#2, started ")
    page.get_by_role("button", name="back to arm/journal#1").click()
    expect_task(page, "walk")
    expect(page.locator("#runs option:checked")).to_have_text("arm/journal#1")


@pytest.mark.soak
def test_deleted_run_stays_on_the_page(
    open_page: OpenPage, serve: Callable[..., str], start: Start
) -> None:
    first, second = start("arm", WALK), start("leg", REST)
    page = open_page(serve())
    page.locator(".row").click()
    second.stop()
    shutil.rmtree(second.journal)
    page.locator("#runs").focus()
    expect(page.locator("#runs option:checked")).to_have_text("leg/journal (removed)")
    expect(page.locator("#runs option")).to_have_count(2)
    first.stop()


def write_second_run(folder: Path) -> None:
    story = stumbling()
    story.entries[0].facts[0] = facts.Opened(JOURNAL_VERSION, "later", 1, 1_700_000_100.0, "0.1.0")
    (folder / "00000002.tcaj").write_bytes(story.encoded())


def test_chooser_lists_each_run_of_a_folder(open_page: OpenPage, tmp_path: Path) -> None:
    folder = walking().write(tmp_path / "mixed")
    write_second_run(folder)
    page = open_page(folder)
    expect(page.locator("#runs option")).to_have_text(["mixed#2 (newest)", "mixed#1"])
    expect(page.locator(".row[data-task='3'] .why")).to_contain_text("killed")
    page.route("**/api/outcome*", lambda route: route.fulfill(body=""))
    page.locator("#outcomes").click()
    expect(page.locator("#all td:last-child")).to_have_text(
        [re.compile("^The server does not answer")] * 2
    )
    page.unroute("**/api/outcome*")
    page.keyboard.press("Escape")
    page.locator("#outcomes").click()
    second, first = page.locator("#all tr:nth-child(2) td"), page.locator("#all tr:nth-child(3) td")
    expect(second).to_have_text(
        [
            "mixed#2",
            re.compile("2023"),
            "5 s",
            "ended",
            re.compile("^1 killed8 tasks in allfailure 'terrain collision' of"),
        ]
    )
    expect(first).to_have_text(
        ["mixed#1", re.compile("2023"), "4 s", "not closed", "1 achieving8 tasks in all"]
    )
    first.get_by_role("button").click()
    expect(page.locator(".row[data-task='3'] .why")).to_contain_text(
        "until take steps {2} is achieved"
    )


@pytest.mark.soak
def test_run_list_shows_the_whole_damage_of_a_journal(
    open_page: OpenPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    journals = default_journals()
    for name, content in {"20231115-garbage": b"no journal", "20231116-empty": b""}.items():
        (journals / name).mkdir(parents=True)
        (journals / name / "00000001.tcaj").write_bytes(content)
    page = open_page(stumbling().write(journals / "20231114-walk"))
    page.locator("#outcomes").click()
    cells = page.locator("#all td:last-child")
    expect(cells).to_have_text(
        [
            re.compile(
                "^/.*/20231116-empty: empty, .*'tca log show --follow' wait for the first entry$"
            ),
            re.compile("^/.*/20231115-garbage/00000001.tcaj: not a journal of tca central$"),
            re.compile("^1 killed8 tasks in allfailure 'terrain collision' of"),
        ]
    )
    for width in (1280, 800, 600):
        page.set_viewport_size({"width": width, "height": 700})
        assert page.evaluate(
            "document.getElementById('all').scrollWidth <= document.getElementById('all').clientWidth"
        )


@pytest.mark.soak
def test_page_of_a_log_announces_a_newer_run_when_opened(
    open_page: OpenPage, serve: Callable[..., str], tmp_path: Path
) -> None:
    folder = walking().write(tmp_path / "walk")
    address = serve(folder)
    page = open_page(address)
    expect(page.locator("#counts")).to_contain_text("1 handling")
    write_second_run(folder)
    for where in ("", "#t=1.4&task=7"):
        expect(page.locator("#newer")).to_contain_text("a newer run has started: walk#2")
        expect(page.locator("#runs option:checked")).to_have_text("walk#1")
        page = open_page(address, where)
    page.locator("#newer button").click()
    expect(page.locator("#status")).to_have_text("ended")
    expect(page.locator("#newer")).to_be_hidden()
    page.locator("#runs").select_option(label="walk#1")  # chosen
    expect(page.locator("#status")).to_have_text("not closed")
    expect(page.locator("#newer")).to_be_hidden()


@pytest.mark.soak
def test_page_of_an_old_log_ignores_runs_that_existed_before(
    open_page: OpenPage, tmp_path: Path
) -> None:
    folder = walking().write(tmp_path / "walk")
    write_second_run(folder)
    page = open_page(folder.with_name("walk#1"))
    expect(page.locator("#runs option")).to_have_text(["walk#2 (newest)", "walk#1"])
    expect(page.locator("#status")).to_have_text("not closed")
    expect(page.locator("#newer")).to_be_hidden()
