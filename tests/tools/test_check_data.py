"""Properties with data, checked against declared formats; vacuous properties; lost entries."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random

import msgpack
import pytest
from tools.runs import walk
from tools.story import Story
from tools.test_check_command import HOLDS, run, written
from tools.test_every_tool import with_holes

from tca_tools.properties.field_values import split_data
from tca_tools.properties.predicates import predicate_from
from tca_wire.journal import facts
from tca_wire.journal.records import record
from tca_wire.messages.formats import NO_DATA
from tca_wire.messages.schemas import schema_text
from tca_wire.vocabulary import MessageClass

FOOT = (
    '{"$defs":{"Foot":{"type":"object","properties":{"leg":{"type":"integer"},"at":{"type":"object","properties":'
    '{"x":{"type":"number"}}},"mode":{"enum":["slow","fast"]},"why":{"anyOf":[{"type":"string"},{"type":"null"}]}}}},'
    '"$ref":"#/$defs/Foot"}'
)
FORMATS = {
    "move leg": FOOT,
    "fry": schema_text(str),
    "count": schema_text(list[int]),
    "give up": NO_DATA,
}


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    story = Story().module("user").module("legs", *FORMATS).at(1.0)
    for name, schema in FORMATS.items():
        story.say(facts.FormatDefined(name, MessageClass.COMMAND, schema, "", "legs"))
    sent = {
        "move leg": {"leg": 2, "at": {"x": 1.5}, "mode": "slow", "why": None, "more": b"xyz"},
        "fry": "dish 0b",
        "count": [1, 2],
        "give up": {"reason": "tired"},  # a failure's data, for an exception handler without data
    }
    for name, data in sent.items():
        story.at(story.entries[-1].time + 1.0).acted(
            story.command(name, "user", data=data), "legs", 0.5
        )
    return story.write(tmp_path / "run")


BEGUN = [
    "move leg with leg=2",
    "move leg with at.x=1.5, mode=slow",
    "move leg with why=null",
    "move leg with more=eHl6",
    'fry with data="dish 0b"',
    "fry with data=dish 0b",
    "fry with data='dish 0b'",
    "count with data=[1, 2]",
    "anything with leg=2",
    "give up with reason=tired",
    'give up with data={"reason": "tired"}',
]


@pytest.mark.parametrize("text", BEGUN)
def test_property_finds_messages_begun_with_given_data(journal: Path, text: str) -> None:
    result = run(journal, "--property", f"never begun of {text}")
    assert (result.exit_code, "BROKEN at " in result.stdout) == (1, True), result.output
    assert run(journal, "--property", f"eventually begun of {text}").exit_code == 0


def test_handled_by_property_compares_data(journal: Path) -> None:
    assert run(journal, "--property", "never handled by legs with leg=2").exit_code == 1
    assert run(journal, "--property", "never handled by legs with leg=3").exit_code == 0


def test_data_that_no_message_can_have_is_refused(
    journal: Path, approve: Callable[..., None]
) -> None:
    def refusal_of(text: str) -> str:
        refusals = set()
        for shape in (
            "never begun of {}",
            "at most 1 begun of {}",
            "begun of {} before begun of fry",
        ):
            asked = shape.format(text)
            result = run(journal, "--property", asked)
            assert (result.exit_code, result.stdout) == (2, "")
            refusals.add(result.stderr.splitlines()[-1].replace(asked, text))
        (refusal,) = refusals
        return refusal

    approve("transcripts/bad_data.txt", refusal_of)


SAYS_NOTHING = [
    ("never begun of move leg with leg=3", "move leg with leg=3"),
    ("at most 1 begun of fry with data=dish 0c in all", "fry with data='dish 0c'"),
    ("at most 1 retried of fry", "fry retried"),
    ("fry begun before fry killed", "fry killed"),
]


@pytest.mark.parametrize(("text", "what"), SAYS_NOTHING)
def test_vacuous_property_is_reported_as_vacuous(journal: Path, text: str, what: str) -> None:
    result = run(journal, "--property", text)
    assert result.exit_code == 0
    assert (
        f"good: {text} (which says nothing: in this run there never was '{what}')\n"
        in result.stdout
    )
    assert result.stdout.count("says nothing") == 1


def test_tested_property_is_not_called_vacuous(journal: Path) -> None:
    for text in (
        "never failed of fry",
        "at most 1 begun of fry",
        "never killed of move leg with leg=2",
    ):
        assert run(journal, "--property", text).stdout.endswith(f"good: {text}\n")


def test_quotes_protect_words_of_the_property_language() -> None:
    head, wanted = split_data(
        """begun   of 'x with a=1' with b="two,  c=3", c='four with d=5', d=[1, 2], e="\\"" """
    )
    assert head == "begun of 'x with a=1'"
    assert [str(one) for one in wanted] == [
        "b='two,  c=3'",
        "c='four with d=5'",
        "d=[1, 2]",
        "e='\"'",
    ]
    held = predicate_from("handled of 'move leg' with leg=2, pose.x=1.5, mode=slow")
    assert (held.message, held.words) == (
        "move leg",
        "move leg handled with leg=2, pose.x=1.5, mode='slow'",
    )


FILE = """
from tca_tools.explore import at_most, begun, never
from tca_module import Command

AT_MOST = at_most(1, begun(Command("fly", int)))
MINE = never(begun(Command("fry", str), "dish 0b"))
"""


def test_vacuous_explorer_property_is_reported_as_vacuous(journal: Path, tmp_path: Path) -> None:
    file = tmp_path / "properties.py"
    file.write_text(FILE)
    output = run(journal, file).stdout
    assert (
        "good: at most 1 fly begun (which says nothing: in this run there never was 'fly')"
        in output
    )
    assert "never fry begun with data='dish 0b'\n  fry {2}\n" in output


# --- journals with lost or unknown parts: no uncertain claim --------------------------------------


PROPERTIES = [
    *(text for text in HOLDS if "with" not in text),
    "always sent of anything",
    "at most 3 handled of anything",
    "eventually handled of check",
]
LOST_FILE = """
from tca_tools.explore import achieved, always, before, begun, eventually, handled, never, within
from tca_module import Command, Goal
import tca_tools.properties as properties

STEP, MOVE, WALK = Goal("step", int), Command("move", int), Goal("walk", int)
ORDER = before(begun(STEP), begun(MOVE))
SOON = within(100, handled(STEP), begun(MOVE))
DONE = eventually(achieved(WALK))
JOINED = always(lambda world: "planner" in world.modules or world.now < 1)
MINE = properties.always(lambda world: "planner" in world.modules or world.now < 1)
NONE = properties.never(lambda world: not world.modules and world.now > 1)
"""


def output_of(text: str, path: Path) -> str:
    return run(path, "--property", text).stdout


@pytest.mark.parametrize("seed", range(8))
def test_holding_property_is_not_broken_by_lost_entries(tmp_path: Path, seed: int) -> None:
    entries, chance = walk(), Random(seed)
    whole, path, file = (
        written(tmp_path / "whole.tcaj", entries),
        tmp_path / "walk.tcaj",
        tmp_path / "mine.py",
    )
    file.write_text(LOST_FILE)
    holding = [text for text in PROPERTIES if "BROKEN" not in output_of(text, whole)]
    assert "BROKEN" not in run(whole, file).stdout
    holes = sorted(chance.sample(range(len(entries)), chance.choice([1, 2, 8])))
    path.write_bytes(with_holes(entries, holes))
    output = run(path, *(part for text in holding for part in ("--property", text)), file).stdout
    assert "BROKEN" not in output
    assert "good: never" not in output
    for text in holding:
        assert f"no breach in the readable part: {text}" in output


def with_unknown(place: int) -> bytes:
    """Return the walk, with an unknown fact inside one entry."""
    content = [record(entry) for entry in walk()]
    entry = msgpack.unpackb(content[place][10:], strict_map_key=False)
    entry[2].insert(0, ["brand new", 1])
    payload = msgpack.packb(entry)
    content[place] = struct.pack(">BIBI", 206, len(payload), 206, zlib.crc32(payload)) + payload
    return b"".join(content)


@pytest.mark.parametrize("place", range(0, 70, 6))
def test_unknown_fact_breaks_no_property_and_is_reported(tmp_path: Path, place: int) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_unknown(place))
    result = run(path, "--property", "step begun before move begun", "--property", "never stuck")
    assert "BROKEN" not in result.stdout
    assert result.exit_code == 1
    assert result.stdout.count("there is a fact that this version does not know") == 1
    assert "no breach in the readable part: step begun before move begun" in result.stdout
    assert "a fact that this version does not know is left out" in result.stderr


def test_certain_breaches_are_found_despite_an_unknown_fact(tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_unknown(2))
    result = run(
        path, "--property", "never failed of move", "--property", "at most 0 handled of move"
    )
    assert result.stdout.count("BROKEN") == 2


def test_unreadable_places_after_the_fifth_are_counted(tmp_path: Path) -> None:
    entries = walk()
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_holes(entries, list(range(1, len(entries), 2))))
    output = run(path).stdout
    assert output.count("can't be read: the messages under way then are unknown") == 5
    assert "more gaps" in output
    assert "BROKEN" not in output
