"""``tca gantt -o``: shapes and colours, file formats, and very many bars."""

import math
import re
import sys
from collections.abc import Callable
from colorsys import rgb_to_hls
from operator import mul
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from tools.story import COMMAND, Story, locking, made, stepping, stumbling, walking

from tca_tools.drawing.svg import width_of
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.build import chart
from tca_tools.gantt.chart import Bar, BarKind, ResourceRow
from tca_tools.gantt.looks import STYLE, dark, light
from tca_tools.gantt.queues import curve, is_curve, queue_height
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.window import Pick
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome

Tca = Callable[..., Result]
SVG = "{http://www.w3.org/2000/svg}"


def drawn(story: Story, pick: Pick | None = None) -> str:
    return svg_text(chart(story.fold(), pick=pick) if pick else chart(story.fold()), "run")


def shapes(picture: str) -> str:
    """Return one line for each shape: its look, its place and its title."""
    lines = []
    for one in ET.fromstring(picture).iter():
        look = one.get("class") or one.get("fill", "")
        where = f"{float(one.get('x', 0)):.0f}" + (
            f"+{float(one.get('width', 0)):.0f}" if one.get("width") else ""
        )
        if one.tag in (f"{SVG}rect", f"{SVG}text", f"{SVG}path") and (
            one.get("x") or one.tag == f"{SVG}path"
        ):
            lines.append(
                f"{one.tag.removeprefix(SVG)} {look} {where}: {one.findtext(f'{SVG}title') or one.text or ''}"
            )
    return "\n".join(lines) + "\n"


def test_gantt_picture_matches_its_transcript(expect: Callable[[str, str], None]) -> None:
    expect("gantt_picture", shapes(drawn(stumbling())) + shapes(drawn(locking())))


def shop(
    *failing: int, outcome: Outcome = Outcome.FAILED, steps: int = 1000, rows: int = 1
) -> Story:
    """Return a story of many short steps, spread over *rows* rows. The *failing* steps have another
    outcome.
    """
    story = Story()
    for number in range(rows):
        story.module(f"legs {number}", "step")
    for number in range(steps):
        command = story.at(float(number)).received("step", COMMAND, "x")
        how = outcome if number in failing else Outcome.DONE
        story.delivered(command, f"legs {number % rows}").at(number + 0.5).returned(command, how)
    return story


# --- looks and meanings ---------------------------------------------------------------------------


def test_narrow_failed_bars_have_flags_above_their_row() -> None:
    found = re.findall(
        r'class="flag ink-failed" d="M([\d.]+) .*?<title>(.*?)</title>',
        drawn(shop(100, 500, 501, 502)),
    )
    [(first, first_title), (second, second_title)] = [(float(left), title) for left, title in found]
    assert first_title.startswith("step {101} handled by legs 0 from 100.000 s to 100.500 s")
    assert second_title.startswith("3 failures from 500.500 s to 502.500 s, first: step {501}")
    assert second - first == pytest.approx((501.5 - 100.5) / 999.5 * 1700, abs=1)


def test_legend_lists_flags_in_their_colours() -> None:
    looks = ('class="flag-failed"', 'class="flag-handled"')
    for story, seen in ((made("asking"), (0, 1)), (shop(3), (1, 0)), (shop(), (0, 0))):
        assert tuple(map(drawn(story).count, looks)) == seen


@pytest.mark.parametrize(("steps", "look"), [(3, 'class="end"'), (1000, 'class="ink-killed"')])
def test_killed_bar_has_a_dark_end(steps: int, look: str) -> None:
    """If the bar is narrow, or part of a block of many bars, it has a foot instead."""
    plain, killed = (drawn(shop(*bad, outcome=Outcome.KILLED, steps=steps)) for bad in ((), (2,)))
    assert killed.count(look) > plain.count(look)
    assert (">killed</text>" in killed, ">killed</text>" in plain) == (True, False)


def test_failed_bar_is_visible_in_a_block() -> None:
    whole, failed = (drawn(shop(*bad)) for bad in ((), (999,)))
    assert failed.count("ink-failed") == whole.count("ink-failed") + 2  # a foot and a flag


def test_story_picture_shows_awaited_bars_paler(tmp_path: Path, tca: Tca) -> None:
    folder = locking().write(tmp_path / "locking")
    assert tca("gantt", folder, "--story", 4, "-o", tmp_path / "story.svg").exit_code == 0
    picture = ET.fromstring((tmp_path / "story.svg").read_text())
    titled = {
        (rectangle.findtext(f"{SVG}title") or "").split(" from ")[0]: rectangle.get("class")
        for rectangle in picture.iter(f"{SVG}rect")
    }
    assert titled["move {4} handled by legs"] is None
    assert titled["move {2} handled by legs"] == "beside"  # used the legs
    assert titled["look {3} handled by eyes"] == "beside"  # had locked them
    assert "adjust {5} handled by legs" not in titled
    written = {
        one.text: one.get("class", "").partition(" ")[0] for one in picture.iter(f"{SVG}text")
    }
    assert written["look"] == "in"  # dark: white is illegible there


def distance(one: str, other: str) -> float:
    """Return the visible difference of two colours. From black to white it is 1 (Ottosson, Oklab,
    2020).
    """
    return math.dist(oklab(one), oklab(other))


def oklab(colour: str) -> list[float]:
    linear = [(int(colour[place : place + 2], 16) / 255) ** 2.2 for place in (1, 3, 5)]
    cones = [
        sum(map(mul, row, linear)) ** (1 / 3)
        for row in ((0.4122, 0.5363, 0.0514), (0.2119, 0.6807, 0.1074), (0.0883, 0.2817, 0.6300))
    ]
    return [
        sum(map(mul, row, cones))
        for row in ((0.2105, 0.7936, -0.0041), (1.9780, -2.4286, 0.4506), (0.0259, 0.7828, -0.8087))
    ]


def test_message_colours_differ_from_colours_with_a_meaning() -> None:
    """No colour looks red, amber or grey, and each one leaves its text legible."""
    amber = re.findall(r"\.ink-handled[^#]*(#\w+)", STYLE)[0]
    assert len({dark(number) for number in range(40)}) == 40
    for number in range(200):
        red, green, blue = (int(dark(number)[place : place + 2], 16) for place in (1, 3, 5))
        hue, _, saturation = rgb_to_hls(red / 255, green / 255, blue / 255)
        assert saturation > 0.25
        assert distance(dark(number), amber) > 0.15
        assert 0.05 < hue < 0.93
        assert red + green + blue < 420
        assert all(int(light(number)[place : place + 2], 16) > 150 for place in (1, 3, 5))


def test_long_label_has_the_full_name_as_tooltip() -> None:
    name = "controller of the left " * 3
    picture = drawn(Story().module(name, "move").module("legs", "step"))
    assert re.findall(r'class="label"[^>]*>(.*?)</text>', picture) == [
        f"{name[:39]}…<title>{name}</title>",
        "legs",
    ]


def test_gantt_picture_escapes_hostile_names() -> None:
    story = Story().module("<&>\x1b\x00", 'a "b"')
    goal = story.goal("</svg>\x07", "x")
    story.queued(goal, "<&>\x1b\x00").at(1.0).delivered(goal, "<&>\x1b\x00").at(2.0)
    picture = svg_text(chart(story.fold()), "]]> & <title>")
    assert "</svg>\\x07" in [text.text for text in ET.fromstring(picture).iter(f"{SVG}text")]


@pytest.mark.parametrize(
    ("words", "pixels"),
    [  # measured by a browser in the font of the pictures
        ("waiting for a reply, task or lock", 160),
        ("failed, and handled", 101),
        ("traverse path", 70),
        ("MOVE WHEELS", 89),
        ("plan body move", 85),
    ],
)
def test_width_of_is_close_to_the_browser_width(words: str, pixels: float) -> None:
    assert pixels <= width_of(words) <= 1.25 * pixels + 4


# --- queues ---------------------------------------------------------------------------------------

SCALE = Scale(1000.0, 0.0, 1000.0)


def queue(*bars: tuple[float, float], is_without_module: bool = False) -> ResourceRow:
    """Return a row of queued bars, one a lane, on a plot of 1000 pixels and seconds."""
    waiting = [
        Bar("step", start, end, kind=BarKind.QUEUED, lane=lane)
        for lane, (start, end) in enumerate(bars)
    ]
    return ResourceRow("legs", queued=waiting, is_without_module=is_without_module)


def test_queue_is_a_curve_when_its_bars_are_narrow_or_many() -> None:
    assert not is_curve(queue((0, 40), (10, 50), (20, 25)), SCALE)
    assert is_curve(queue((0, 4), (10, 15), (20, 25)), SCALE)
    assert is_curve(queue(*[(0, 40)] * 7), SCALE)
    assert not is_curve(queue(*[(0, 40)] * 3, is_without_module=True), SCALE)
    assert is_curve(
        queue(*[(0, 40)] * 4, is_without_module=True), SCALE
    )  # rows without a module take less room


@pytest.mark.parametrize(
    ("bars", "left", "right"),
    [
        ([(200, 900)] * 7, 100, 200),  # left of the highest step
        ([(0, 100)] * 7, 100, 260),  # right of it
        ([(0, 1000)] * 7, 0, 1001),  # over it, in the row
    ],
)
def test_curve_number_is_beside_its_highest_step(
    bars: list[tuple[float, float]], left: float, right: float
) -> None:
    *_, words = curve(queue(*bars), SCALE, 1.0, 0.0)
    found = re.search(r'class="number( before)?" x="([\d.]+)"[^>]*>(up to [^<]+)', words)
    assert found
    begin = float(found[2]) - (width_of(found[3]) if found[1] else 0)
    assert left <= begin <= right - width_of("up to 7 queued")


def test_curve_of_one_waiting_message_has_no_number() -> None:
    row = queue((0, 4), is_without_module=True)
    assert len(list(curve(row, SCALE, 1.0, 0.0))) == 1
    assert queue_height(row, is_curve=True) == queue_height(row, is_curve=False)


def test_legend_lists_only_patterns_in_the_picture() -> None:
    story = Story().module("legs", "step").at(1.0)
    tasks = [TaskId(story.command("step", "user")) for _ in range(5)]
    picture = drawn(story.say(*(facts.SuspendedOrResumed(task, True) for task in tasks)).at(9.0))
    assert ">number queued or suspended</text>" in picture
    assert "up to 5 suspended" in picture
    assert ">suspended</text>" not in picture


# --- very many ------------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [4, 300])
def test_held_tasks_beyond_the_limit_are_summarised(steps: int) -> None:
    picture = drawn(stepping(steps=steps), Pick(held=range(1, 2 + steps)))
    texts = [one.text or "" for one in ET.fromstring(picture).iter(f"{SVG}text")]
    assert picture.count('stroke-dasharray="4 3"') <= 1 + 6  # six tasks and the legend
    assert ("more are held" in picture) == (steps > 7)
    assert ("step {4}: until step {3} is achieved" in texts) == (
        steps < 7
    )  # narrow bars have no words


@pytest.mark.soak
def test_picture_of_a_long_run_has_bounded_size() -> None:
    picture = drawn(shop(steps=7_000, rows=10))
    assert float(ET.fromstring(picture).get("width", 0)) <= 2_000
    assert picture.count("<rect") < 6_000
    assert re.search(
        r"\d+ messages from [\d.]+ s to [\d.]+ s, [\d.]+% of the time: \d+ step", picture
    )


# --- files ----------------------------------------------------------------------------------------


def test_gantt_writes_each_kind_of_file(tca: Tca, run: Path, tmp_path: Path) -> None:
    beginnings = {
        "svg": b"<svg",
        "txt": b"run: 0.42",
        "html": b"<!doctype html>",
        "png": b"\x89PNG",
        "pdf": b"%PDF",
    }
    for kind, beginning in beginnings.items():
        result = tca("gantt", run, "-o", tmp_path / f"chart.{kind}")
        assert result.exit_code == 0, result.stderr
        assert (tmp_path / f"chart.{kind}").read_bytes().startswith(beginning)
    assert (
        "must end in .svg, .png, .pdf, .html or .txt"
        in tca("gantt", run, "-o", tmp_path / "chart.gif").stderr
    )


def test_png_without_its_package_names_the_extra(
    tca: Tca, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "vl_convert", None)
    result = tca("gantt", run, "-o", tmp_path / "chart.png")
    assert (result.exit_code, "pip install 'tca-central[pictures]'" in result.stderr) == (1, True)
    assert not (tmp_path / "chart.png").exists()


def test_gantt_page_is_self_contained_and_well_formed(tca: Tca, tmp_path: Path) -> None:
    folder = walking().write(tmp_path / "</script>")
    tca("gantt", folder, "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert not re.findall(r"(?:src|href|url)\s*[=(]\s*['\"]?\s*(?:https?:)?//", page)
    assert page.count("</script>") == 1
    for drawing in re.findall(r"<svg .*?</svg>", page, re.DOTALL):
        ET.fromstring(drawing)
    assert "z16" in page  # the class of shapes shown only when zoomed
