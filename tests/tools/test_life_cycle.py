"""``tca lifecycle``: tables and diagrams of life cycles. A life cycle may be built in, in a file,
or a message's.
"""

import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from tools.story import COMMAND, QUERY, Story

from tca_tools.life_cycle.dot import dot_source
from tca_wire.journal import facts
from tca_wire.life_cycles import BASIC, GENERAL, LifeCycle, Transition, ending
from tca_wire.vocabulary import Party

Tca = Callable[..., Result]
needs_dot = pytest.mark.skipif(
    not (shutil.which("dot") or find_spec("pygraphviz")), reason="Graphviz is not installed"
)
ROBOT = """
from tca_module import GENERAL, Command, LifeCycle, Party, Transition, ending
PAUSABLE = LifeCycle("pausable", [*GENERAL.transitions, Transition("pause", "running", "paused", Party.CLIENT),
    Transition("resume", "paused", "running", Party.BOTH), *ending("paused")])
WALK, REST = Command("walk", life_cycle=PAUSABLE), Command("rest")
"""
PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("resume", "paused", "running", Party.BOTH),
        *ending("paused"),
    ],
)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.py"
    path.write_text(ROBOT)
    return path


def test_life_cycle_tables_match_their_transcripts(
    tca: Tca, robot: Path, expect: Callable[[str, str], None]
) -> None:
    expect("life_cycle_general", tca("lifecycle").stdout)
    expect("life_cycle_basic", tca("lifecycle", "basic").stdout)
    expect("life_cycle_pausable", tca("lifecycle", robot).stdout)


def test_life_cycle_table_is_cut_to_the_terminal(tca: Tca) -> None:
    assert all(len(line) <= 40 for line in tca("lifecycle", COLUMNS="40").stdout.splitlines())


def test_life_cycle_diagrams_match_their_transcripts(expect: Callable[[str, str], None]) -> None:
    """A transition that all active states have is drawn once, from the frame around them."""
    expect("life_cycle_general_dot", dot_source(GENERAL))
    expect("life_cycle_pausable_dot", dot_source(PAUSABLE))


@needs_dot
@pytest.mark.parametrize("life_cycle", [BASIC, GENERAL, PAUSABLE], ids=str)
def test_diagram_has_every_state_and_transition(
    tca: Tca, tmp_path: Path, robot: Path, life_cycle: LifeCycle
) -> None:
    picture = tmp_path / "picture.svg"
    assert (
        tca("lifecycle", robot if life_cycle == PAUSABLE else life_cycle.name, "-o", picture).stderr
        == ""
    )
    words = [one.text or "" for one in ET.parse(picture).iter("{http://www.w3.org/2000/svg}text")]
    assert set(life_cycle.states) <= set(words)
    for one in life_cycle.transitions:
        assert one.name in words or f"{one.name} ({one.by})" in words
    assert "black: by server" in words
    assert ("violet: by client or server" in words) == (life_cycle == PAUSABLE)
    assert ("dashed, blue: by client" in words) == (life_cycle != BASIC)


def test_diagram_quotes_hostile_state_names() -> None:
    own = LifeCycle('a "b" \\', [Transition('go"', "initiated", 'x"];'), *ending('x"];')])
    source = dot_source(own)
    assert r'label="x\"];"' in source
    assert r"life cycle 'a \"b\" \\'" in source


@needs_dot
def test_life_cycle_is_written_in_each_format(tca: Tca, tmp_path: Path) -> None:
    for suffix in (".svg", ".png", ".pdf", ".html", ".dot", ".txt"):
        assert tca("lifecycle", "basic", "-o", tmp_path / f"basic{suffix}").exit_code == 0
    assert (tmp_path / "basic.txt").read_text().startswith("life cycle 'basic'\n")
    assert (tmp_path / "basic.html").read_text().startswith("<!doctype html>")


def test_life_cycle_svg_without_graphviz_fails_and_dot_works(
    tca: Tca, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(__import__("sys").modules, "pygraphviz", None)
    result = tca("lifecycle", "-o", tmp_path / "general.svg")
    assert (result.exit_code, list(tmp_path.iterdir())) == (1, [])
    assert result.stderr == (
        "Error: this picture needs the Python package 'pygraphviz': pip install 'tca-central[pictures]', or install"
        " Graphviz\n"
    )
    assert tca("lifecycle", "-o", tmp_path / "general.dot").exit_code == 0


def test_life_cycle_of_a_message_is_read_from_a_run(tca: Tca, tmp_path: Path) -> None:
    story = Story()
    story.say(facts.FormatDefined("walk", COMMAND, "null", "null", "planner", PAUSABLE.text))
    story.say(facts.FormatDefined("rest", COMMAND, "null", "null", "planner"))
    story.say(facts.FormatDefined("where", QUERY, "null", "null", "planner"))
    run = story.write(tmp_path / "run")
    assert tca("lifecycle", "walk", run).stdout.startswith("life cycle 'pausable'\n")
    assert tca("lifecycle", "rest", run).stdout.startswith("life cycle 'general'\n")
    wrong = {
        "where": "query 'where' is not a task: only tasks have a life cycle",
        "wolk": "no message 'wolk' in the journal run: did you mean 'walk'?",
    }
    for name, words in wrong.items():
        result = tca("lifecycle", name, run)
        assert (result.exit_code, result.stderr) == (1, f"Error: {words}\n")


def test_unusable_life_cycle_source_is_refused(tca: Tca, tmp_path: Path, robot: Path) -> None:
    empty, broken = tmp_path / "empty.py", tmp_path / "broken.py"
    empty.write_text("X = 1\n")
    broken.write_text("\nfrom tca_module import LifeCycle\nX = LifeCycle('x', [])\n")
    wrong = {
        (tmp_path / "none.py",): f"{tmp_path}/none.py: no such file",
        (
            empty,
        ): f"{empty} has no life cycle: declare a LifeCycle, goal or command in a global variable",
        (
            broken,
        ): f"{broken}, line 3: can't be run: BadFormat: life cycle 'x' is not valid: no transition of the server",
        ("basic", "-o", tmp_path / "x.gif"): f"{tmp_path}/x.gif: its name must end in .svg",
    }
    for arguments, words in wrong.items():
        result = tca("lifecycle", *arguments)
        assert result.exit_code == 2
        assert words in result.stderr
    robot.write_text(ROBOT + "OTHER = LifeCycle('other', GENERAL.transitions)\n")
    assert "robot.py has 2 life cycles (pausable, other), but a diagram shows only one" in (
        tca("lifecycle", robot, "-o", tmp_path / "x.svg").stderr
    )
