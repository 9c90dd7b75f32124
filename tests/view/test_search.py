"""The search of the page. Messages without a row are found, and a search can be continued."""

from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import Story, made

from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome
from view.conftest import OpenPage

pytestmark = pytest.mark.slow


def test_search_finds_queries_and_informs_by_name(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("looking").write(tmp_path / "maps"))
    for words, order, summary in (
        ("map", [4, 2, 3], "3 found"),
        ("map torn", [3], "1 found"),
        ("map failed", [3], "1 found"),
        ("maps", [4], "1 found"),  # by module, tasks only
        ("map maps", [4, 2, 3], "3 found"),
        ("battery", [5], "1 found"),
        ("3", [3], "1 found"),
        ("look", [1], "1 found"),
    ):
        page.locator("#search").fill(words)
        expect(page.locator("#found")).to_have_text(summary)
        assert page.evaluate("[...tca.tree.found].map((one) => one.id)") == order
    page.locator("#search").fill("battery")
    page.keyboard.press("Enter")
    expect(page.locator("#task h2")).to_have_text("battery low {5}")
    page.locator("#search").fill("map")
    page.evaluate("tca.slider.setTime(1.7)")
    expect(page.locator("#found")).to_have_text("1 found, 2 later")
    for words, time, named in (
        ("draw", "4.000 s", "draw map {4}"),
        ("battery", "6.000 s", "battery low {5}"),
    ):
        page.locator("#search").fill(words)
        expect(page.locator("#found")).to_have_text("0 found, 1 later")
        page.keyboard.press("Enter")
        expect(page.locator("#found")).to_have_text("1 of 1")
        expect(page.locator("#clock")).to_have_text(time)
        expect(page.locator("#task h2")).to_have_text(named)
    page.evaluate("tca.slider.setTime(5.5)")  # new entries do not return to the first result
    page.locator("#search").fill("map")
    expect(page.locator("#found")).to_have_text("3 found")
    for _ in range(2):
        page.keyboard.press("Enter")
    expect(page.locator("#found")).to_have_text("2 of 3")
    page.evaluate("tca.slider.setTime(6.5)")
    expect(page.locator("#clock")).to_have_text("6.500 s")
    expect(page.locator("#found")).to_have_text("2 of 3")
    page.keyboard.press("Enter")
    expect(page.locator("#task h2")).to_have_text("map {3}")
    page.locator("#search").fill("map map")  # a new search begins at the start
    expect(page.locator("#found")).to_have_text("3 found")


def test_search_finds_failures_by_text(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("stove", "fry", "boil").at(1.0)
    fry, boil = story.command("fry", "user"), story.command("boil", "user")
    story.delivered(fry, "stove").queued(boil, "stove").at(2.0).returned(fry, Outcome.FAILED)
    story.say(facts.Failed(fry, "burnt", "flames everywhere")).reached(fry, *Moment).at(3.0)
    page = open_page(story.write(tmp_path / "kitchen"))
    for words, found in (
        ("burnt", 1),
        ("Flames", 1),
        ("fail", 1),
        ("failed fry burnt", 1),
        ("boil burnt", 0),
        ("queued stove", 1),
        ("stove", 2),
        ("{2}", 1),
    ):
        page.locator("#search").fill(words)
        expect(page.locator("#found")).to_have_text(f"{found} found")
    page.locator("#search").fill("burnt")
    page.locator("body").press("Home")
    page.evaluate("tca.slider.setTime(1.5)")
    expect(page.locator("#found")).to_have_text("0 found")


@pytest.mark.soak
def test_search_lists_exact_names_first(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("fry van", "deliver").at(1.0)
    day, other = story.goal("day", "user"), story.command("deliver", "user")
    story.delivered(other, "fry van").at(2.0).returned(other).reached(other, Moment.END_ACHIEVING)
    named, idle = story.command("fry", "user"), story.command("late deliver", "user")
    story.say(facts.Killed(TaskId(day), "deliver and fry failed", "user")).at(3.0)
    page = open_page(story.write(tmp_path / "bakery"))
    for words, order in (
        ("deliver", [other, idle, day]),
        ("fry", [named, other, day]),
        ("failed", [day]),
        ("deliver achieved", [other]),
        ("", []),
    ):
        page.locator("#search").fill(words)
        assert page.evaluate("[...tca.tree.found].map((task) => task.id)") == order
    page.locator("#search").fill("deliver")
    for number in (other, idle, day, other):
        page.keyboard.press("Enter")
        expect(page.locator("#task h2")).to_contain_text(f"{{{number}}}")
