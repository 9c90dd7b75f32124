"""A journal that is damaged while the page follows it. The damage is reported at once, and readable
parts are shown.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import Story, silent_for, stumbling, walking

from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION
from tca_wire.journal.records import record
from view.conftest import OpenPage

pytestmark = pytest.mark.slow


def damaged(content: bytes) -> bytes:
    """Return a record with the right length but wrong content."""
    return content[:-3] + bytes(byte ^ 0xFF for byte in content[-3:])


def more(story: Story) -> list[bytes]:
    """Return the records that are written next."""
    known = len(story.entries)
    for time, name in enumerate(("fly", "swim", "dive", "rest"), start=5):
        story.at(time).command(name, "user")
    return [record(entry) for entry in story.entries[known:]]


def test_damaged_entry_is_reported_with_and_without_a_later_one(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = walking()
    run = story.write(tmp_path / "run")
    first, second, third, fourth = more(story)
    with silent_for(run, 1.0):
        page = open_page(run)
        expect(page.locator("#status")).to_have_text("live")
        expect(page.locator("#problem")).to_be_hidden()
        with (run / "00000001.tcaj").open("ab") as segment:
            segment.write(damaged(first) + second)
        expect(page.locator("#problem")).to_contain_text(
            "after 4.000 s: a damaged entry is left out"
        )
        expect(page.locator(".row").last).to_contain_text("swim")
        expect(page.locator("#status")).to_have_text("live")
        with (run / "00000001.tcaj").open("ab") as segment:
            segment.write(damaged(third))
        expect(page.locator("#problem")).to_contain_text(
            f"cut off: the last {len(third)} bytes are not a complete entry"
        )
        expect(page.locator("#status")).to_have_text("live")
        with (run / "00000001.tcaj").open("ab") as segment:
            segment.write(fourth)
        expect(page.locator("#problem")).to_contain_text(
            "after 4.000 s: 2 damaged entries are left out"
        )
        expect(page.locator(".row").last).to_contain_text("rest")


def test_journal_of_a_later_version_is_shown_as_far_as_known(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = walking()
    story.entries[0].facts[0] = facts.Opened(JOURNAL_VERSION + 1, "epoch", 1, 0.0, "9.9")
    page = open_page(story.write(tmp_path / "run"))
    expect(page.locator("#problem")).to_contain_text(
        f"({JOURNAL_VERSION + 1}; this one reads up to {JOURNAL_VERSION})"
    )
    expect(page.locator(".row[data-task='1']")).to_contain_text("traverse arc")


def cut_short(run: Path) -> None:
    segment = run / "00000001.tcaj"
    with segment.open("r+b") as stream:
        stream.truncate(segment.stat().st_size - 200)


def remove(run: Path) -> None:
    (run / "00000001.tcaj").unlink()


def write_nonsense(run: Path) -> None:
    with (run / "00000001.tcaj").open("ab") as stream:
        stream.write(b"X" * 60)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        pytest.param(write_nonsense, "no record starts here", marks=pytest.mark.soak),
        (cut_short, "200 bytes that were read have been cut off"),
        pytest.param(remove, "00000001.tcaj: has been removed", marks=pytest.mark.soak),
        (shutil.rmtree, "can't be read"),
    ],
)
def test_journal_that_cannot_be_followed_is_reported(
    open_page: OpenPage, tmp_path: Path, spoil: Callable[[Path], None], problem: str
) -> None:
    run = walking().write(tmp_path / "run")
    with silent_for(run, 1.0):
        page = open_page(run)
        expect(page.locator("#status")).to_have_text("live")
        spoil(run)
        expect(page.locator("#problem")).to_contain_text(problem)
        expect(page.locator("#status")).to_have_text("damaged")
        expect(page.locator(".row[data-task='1']")).to_contain_text("traverse arc")


@pytest.mark.soak
def test_repaired_or_restored_journal_is_read_again(
    open_page: OpenPage, serve: Callable[[Path], str], tmp_path: Path
) -> None:
    run, away = walking().write(tmp_path / "run"), tmp_path / "away"
    segment, address = run / "00000001.tcaj", serve(run)
    whole, page = segment.read_bytes(), open_page(address)
    expect(page.locator("#status")).to_have_text("not closed")
    cut_short(run)
    expect(page.locator("#problem")).to_contain_text(
        "200 bytes that were read have been cut off; entries read earlier are shown"
    )
    asked = f"{address}api/frame?since=%7B%22entry%22%3A1%7D&token={page.evaluate('tca.store.head.token')}"
    request = page.context.request
    page.close()  # an open page would reload, and the browser would log an error
    segment.rename(away)
    assert request.get(asked).status == 200
    away.rename(segment)
    assert request.get(asked).status == 200
    segment.write_bytes(whole)
    assert request.get(asked).status == 410

    page = open_page(address)
    expect(page.locator("#status")).to_have_text("not closed")
    run.rename(away)
    expect(page.locator("#status")).to_have_text("damaged")
    page.reload()
    expect(page.locator("#status")).to_have_text("damaged")
    expect(page.locator(".row[data-task='1']")).to_contain_text("traverse arc")
    asked = f"{address}api/frame?since=%7B%22entry%22%3A1%7D&token={page.evaluate('tca.store.head.token')}"
    assert request.get(asked).status == 200
    page.close()  # as above
    away.rename(run)
    assert request.get(asked).status == 410
    page = open_page(address)
    expect(page.locator("#status")).to_have_text("not closed")
    expect(page.locator("#problem")).to_be_hidden()
    with segment.open("ab") as stream:
        stream.write(b"".join(more(walking())[:2]))
    expect(page.locator(".row").last).to_contain_text("swim")


def test_silent_server_is_reported_when_the_journal_is_damaged(
    open_page: OpenPage, tmp_path: Path
) -> None:
    run = walking().write(tmp_path / "run")
    page = open_page(run, clock=True)
    cut_short(run)
    expect(page.locator("#status")).to_have_text("damaged")
    page.evaluate("() => { window.fetch = async () => { throw new Error('nobody is there'); }; }")
    page.clock.run_for(2500)
    assert "The server does not answer (nobody is there)" in page.locator("#problem").inner_text()
    assert page.locator("#status").inner_text() == "no answer"


@pytest.mark.soak
def test_page_ignores_another_run_in_the_same_place(
    open_page: OpenPage, serve: Callable[[Path], str], tmp_path: Path
) -> None:
    run = walking().write(tmp_path / "run")
    address = serve(run)
    page = open_page(address)
    expect(page.locator("#status")).to_have_text("not closed")
    shutil.rmtree(run)
    expect(page.locator("#status")).to_have_text("damaged")
    other = stumbling()
    other.entries[0].facts[0] = facts.Opened(
        JOURNAL_VERSION, "another", 1, 1_700_000_100.0, "0.1.0"
    )
    other.write(run)
    page.reload()
    expect(page.locator("#status")).to_have_text("damaged")
    expect(page.locator("#problem")).to_contain_text("can't be read")
    expect(page.locator("#runs option")).to_have_count(2)
    page.locator("#runs").select_option(index=0)
    expect(page.locator("#status")).to_have_text("ended")
