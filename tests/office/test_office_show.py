"""The picture, and the complete demonstration with real processes."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from processes import run

from robots.office_sim.drawing import describe_result, draw
from robots.office_sim.vocabulary import CupState
from robots.office_sim.world import OfficeWorld

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "robots/office_sim"
PAGE = (ROOT / "docs/robots/office.md").read_text()


def count(svg: str, look: str) -> int:
    """Return the number of drawn elements of a kind, without the legend's."""
    return svg.count(f'class="{look}"') - 1


def test_office_picture_shows_the_fate_of_each_cup() -> None:
    world = OfficeWorld(1, 200.0)
    world.advance(120.0)
    scene = world.scene()
    scene.cups[0].state = CupState.BIN
    states = [cup.state for cup in scene.cups]
    svg = draw(scene, "a <lab>")
    ET.fromstring(svg)
    looks = {"collected": CupState.BIN, "taken": CupState.TAKEN, "left": CupState.FLOOR}
    assert {look: count(svg, look) for look in looks} == {
        look: states.count(state) for look, state in looks.items()
    }
    assert CupState.TO_COME in states
    assert svg.count('class="table"') == len(scene.floor.tables)
    left = states.count(CupState.FLOOR)
    assert describe_result(scene).endswith(
        f"1 collected, {states.count(CupState.TAKEN)} taken by people, {left} left; charged 0 times"
    )
    assert "a &lt;lab&gt;: " in svg


@pytest.mark.slow
def test_office_show_runs_a_shift(tmp_path: Path) -> None:
    shown = run("-m", "robots.office_sim", "--shift", "45", "--pace", "25", "--out", str(tmp_path))
    assert (shown.returncode, shown.stderr) == (0, "")
    last = dict(re.findall(r"s  (cup \d+) (.*)\n", shown.stdout))
    collected, taken = (
        list(last.values()).count(f"is {end}") for end in ("in the bin", "taken by a person")
    )
    assert collected + taken == len(last) > 0
    assert f", {collected} collected, {taken} taken by people, 0 left;" in shown.stdout
    made = re.findall(r"^made (.*)$", shown.stdout, re.MULTILINE)
    assert made == [
        str(tmp_path / name) for name in ("lab.svg", "lab.png", "tree.svg", "gantt.svg")
    ]
    svg = tmp_path.joinpath("lab.svg").read_text()
    assert (count(svg, "collected"), count(svg, "taken"), count(svg, "left")) == (
        collected,
        taken,
        0,
    )
    assert "collect cup" in tmp_path.joinpath("tree.svg").read_text()


def test_office_page_quotes_the_robots_code() -> None:
    """The site checks that quoted files exist; here nothing but files is quoted."""
    quoted = re.findall(r"```python title=\"(.*?)\"\n--8<-- \"(.*?)\"\n```", PAGE)
    assert quoted
    assert PAGE.count("```python") == len(quoted)
    for title, file in quoted:
        assert title == file
        assert ROBOT in (ROOT / file).parents
