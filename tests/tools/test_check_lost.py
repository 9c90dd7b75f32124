"""``tca check`` on journals of which something is lost, or not known: nothing is claimed that may not be so."""

import struct
import zlib
from pathlib import Path
from random import Random

import msgpack
import pytest
from tools.runs import walk
from tools.test_check_command import HOLDS, run, written
from tools.test_every_tool import with_holes

from tca_wire.journal.records import record

PROPERTIES = [
    *(text for text in HOLDS if "with" not in text),
    "always sent of anything",
    "at most 3 handled of anything",
    "eventually handled of check",
]
FILE = """
from tca_explorer import achieved, always, before, begun, eventually, handled, never, within
from tca_module import Command, Goal
import tca_properties as properties

STEP, MOVE, WALK = Goal("step", int), Command("move", int), Goal("walk", int)
ORDER = before(begun(STEP), begun(MOVE))
SOON = within(100, handled(STEP), begun(MOVE))
DONE = eventually(achieved(WALK))
JOINED = always(lambda world: "planner" in world.modules or world.now < 1)
MINE = properties.always(lambda world: "planner" in world.modules or world.now < 1)
NONE = properties.never(lambda world: not world.modules and world.now > 1)
"""


def said(text: str, path: Path) -> str:
    return run(path, "--property", text).stdout


@pytest.mark.parametrize("seed", range(8))
def test_what_holds_of_the_run_is_not_said_to_be_broken_where_entries_are_lost(tmp_path: Path, seed: int) -> None:
    entries, chance = walk(), Random(seed)
    whole, path, file = written(tmp_path / "whole.tcaj", entries), tmp_path / "walk.tcaj", tmp_path / "mine.py"
    file.write_text(FILE)
    holding = [text for text in PROPERTIES if "BROKEN" not in said(text, whole)]
    assert "BROKEN" not in run(whole, file).stdout
    holes = sorted(chance.sample(range(len(entries)), chance.choice([1, 2, 8])))
    path.write_bytes(with_holes(entries, holes))
    told = run(path, *(part for text in holding for part in ("--property", text)), file).stdout
    assert "BROKEN" not in told
    assert "good: never" not in told
    for text in holding:
        assert f"no breach in what can be read: {text}" in told


def with_unknown(place: int) -> bytes:
    """The walk, with a fact in the midst of one entry that nobody knows."""
    content = [record(entry) for entry in walk()]
    entry = msgpack.unpackb(content[place][10:], strict_map_key=False)
    entry[2].insert(0, ["brand new", 1])
    payload = msgpack.packb(entry)
    content[place] = struct.pack(">BIBI", 206, len(payload), 206, zlib.crc32(payload)) + payload
    return b"".join(content)


@pytest.mark.parametrize("place", range(0, 70, 6))
def test_an_unknown_fact_may_mean_anything(tmp_path: Path, place: int) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_unknown(place))
    result = run(path, "--property", "step begun before move begun", "--property", "never stuck")
    assert "BROKEN" not in result.stdout
    assert result.exit_code == 1
    assert result.stdout.count("something happened that this version does not know") == 1
    assert "no breach in what can be read: step begun before move begun" in result.stdout
    assert "a fact that this version does not know is left out" in result.stderr


def test_what_is_still_certain_is_still_found(tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_unknown(2))
    result = run(path, "--property", "never failed of move", "--property", "at most 0 handled of move")
    assert result.stdout.count("BROKEN") == 2


def test_many_places_that_cant_be_read_are_counted(tmp_path: Path) -> None:
    entries = walk()
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_holes(entries, list(range(1, len(entries), 2))))
    told = run(path).stdout
    assert told.count("can't be read: what was under way then is not known") == 5
    assert "more places like these" in told
    assert "BROKEN" not in told
