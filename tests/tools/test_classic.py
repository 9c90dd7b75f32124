"""``tca log show --classic``: a journal in the words of TCA's own message log."""

from collections.abc import Callable
from pathlib import Path

from click.testing import Result
from tools.runs import encoded, walk
from tools.story import Story, stumbling

from tca_tools.log.classic import classic_lines
from tca_wire.journal import facts
from tca_wire.vocabulary import MessageClass, Outcome

Tca = Callable[..., Result]


def test_a_walk_that_stumbles(expect: Callable[[str, str], None]) -> None:
    expect("classic_stumbling", "\n".join(classic_lines(stumbling().entries)) + "\n")


def test_a_walk_with_everything(expect: Callable[[str, str], None]) -> None:
    expect("classic_walk", "\n".join(classic_lines(walk())) + "\n")


def test_data_are_indented_and_cut_after_five_lines() -> None:
    story = Story().module("user").module("map", "note")
    note = story.received("note", MessageClass.INFORM, "user", data={"text": "a word " * 100})
    story.say(facts.Delivered(note, note, "map", "map"), facts.Returned(note, Outcome.DONE, b""))
    lines = list(classic_lines(story.entries))
    data = [line for line in lines if line.startswith("    ")]
    assert len(data) == 6
    assert data[-1] == "    ..."
    assert max(map(len, data)) <= 80
    assert lines[-1].split()[:3] == ["Done", "note", "{1}:"]


def test_it_begins_anywhere() -> None:
    entries = walk()
    for start in range(1, len(entries) - 20, 5):
        assert list(classic_lines(entries[start:]))


def test_the_command(tca: Tca, tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    assert tca("log", "show", path, "--classic").stdout.splitlines() == list(classic_lines(walk()))
    refused = tca("log", "show", path, "--classic", "--json")
    assert refused.exit_code == 2
    assert "leave out --json" in refused.stderr
