"""``tca check`` on the command line: its output, stated properties, and incomplete journals."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from central.player import Player
from click.testing import CliRunner, Result
from tools.runs import OPENED, encoded, lost, walk
from tools.story import Story

from tca_tools.check.__main__ import check
from tca_tools.check.rules import RULES
from tca_tools.properties import BadProperty, property_from
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Closed, Entry, kind_of

Check = Callable[..., Result]


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        check, [str(argument) for argument in arguments], prog_name="tca check"
    )


def written(path: Path, entries: list[Entry], *, closed: bool = True) -> Path:
    last = entries[-1]
    end = [Entry(last.number + 1, last.time, [Closed("interrupted")])] if closed else []
    path.write_bytes(encoded([*entries, *end]))
    return path


def steps(*, ahead: int, slots: int = 3) -> list[Entry]:
    """Return a walk of three steps with at most *ahead* of them planned ahead."""
    player = Player()
    player.module("planner", "goal walk", "goal take steps", capacity=slots)
    player.module("legs", "command move")
    player.module("user")
    top = player.task("user", "walk")
    sent: list[int] = []
    for number in range(3):
        flags = Flags.SEQ_ACH | (Flags.DELAY_PLANNING if number > ahead else Flags.NONE)
        sent.append(player.task("planner/1", "take steps", under=top, flags=flags))
    player.reply("planner/1", top)
    for step in sent:
        slot = next(
            (
                slot
                for slot in ("planner/1", "planner/2", "planner/3")
                if step in player.delivered(slot)
            ),
            "",
        )
        player.task(slot, "move", under=step)
        player.reply(slot, step)
        player.reply("legs/1")
    return [OPENED, *player.entries]


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    return written(tmp_path / "walk.tcaj", walk())


# --- the rules ------------------------------------------------------------------------------------


def test_check_summarises_a_good_run(journal: Path) -> None:
    first, second = (result := run(journal)).stdout.splitlines()
    count, begin, end = len(walk()) + 1, walk()[0].number, walk()[-1].number + 1
    pattern = (
        rf"walk.tcaj: \d+ facts in {count} entries \(numbers {begin} to {end}\), 0.00 s to 79.00 s"
    )
    assert re.fullmatch(pattern, first)
    assert (second[:6], second[-6:], result.exit_code) == ("good: ", " rules", 0)


def test_first_broken_rule_has_its_source_and_story(tmp_path: Path) -> None:
    entries = walk()
    place = next(
        at
        for at, entry in enumerate(entries)
        if "returned" in map(kind_of, entry.facts) and at > 31
    )
    entry = entries[place]
    entries[place] = Entry(entry.number, entry.time, lost(entry.facts, 0))
    result = run(written(tmp_path / "broken.tcaj", entries))
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    broken = next(number for number, line in enumerate(lines) if line.startswith("BROKEN"))
    assert f"entry {entry.number}: " in lines[broken]
    assert lines[broken + 2].startswith("  the rule: ")
    assert "  the story of " in lines[broken + 3]
    assert "  command made by central: listener for move {8}" in lines[broken + 4]
    assert sum(line.startswith("BROKEN") for line in lines) == 1
    assert lines[-1].endswith("--all shows them")
    everything = run(tmp_path / "broken.tcaj", "--all")
    assert sum(line.startswith("BROKEN") for line in everything.stdout.splitlines()) > 1


def test_check_runs_as_a_module(journal: Path) -> None:
    command = [sys.executable, "-m", "tca_tools.check", str(journal), "--property", "never stuck"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "good: never stuck"


# --- properties -----------------------------------------------------------------------------------


def test_planned_ahead_property_holds_for_one_step_not_two(tmp_path: Path) -> None:
    wanted = "at most 1 planned ahead of take steps"
    good = run(written(tmp_path / "good.tcaj", steps(ahead=1)), "--property", wanted)
    assert good.exit_code == 0, good.output
    assert good.stdout.splitlines()[-1] == f"good: {wanted}"
    none = run(tmp_path / "good.tcaj", "--property", "at most 0 planned ahead of take steps")
    assert none.exit_code == 1
    bad = run(written(tmp_path / "bad.tcaj", steps(ahead=2)), "--property", wanted)
    assert bad.exit_code == 1
    lines = bad.stdout.splitlines()
    assert any(line.startswith("BROKEN at ") and line.endswith(wanted) for line in lines)
    assert (
        "  here 2: take steps {3}, take steps {2}" in lines
        or "  here 2: take steps {4}, take steps {3}" in lines
    )
    assert any("goal sent by planner" in line for line in lines)


HOLDS = [
    "never failed of step",
    "at most 2 handled by planner",
    "at most 1 handled of move",
    "at most 1 failed of move in all",
    "at most 1 move retried in all",
    "step begun before move begun",
    "begun of step before begun of move",
    "eventually achieved of walk",
    "eventually fired of look",
    "never stuck",
    "never handled of mode with data=4",
    "never look recovering",
    "sent of walk before handled of 'move'",
]
BROKEN = [
    ("never failed of move", "  move {8}"),
    ("always handled of move", "  it is not true here"),
    ("at most 0 queued of anything", "  here 1: "),
    ("at most 1 step achieved in all", "  it has happened 2 times: step {5}"),
    ("move begun before step begun", "  the second came first: step {4}"),
    ("eventually suspended of walk", "  it never did"),
    ("never recovering of anything", "  move {8}"),
]


def test_broken_eventually_shows_the_last_task_and_its_story(tmp_path: Path) -> None:
    story = Story().module("stove", "bake").at(1.0)
    bake, flambe = story.command("bake", "user"), story.command("flambé", "user")
    story.acted(bake, "stove", 1.0).queued(flambe).at(30.0).say(facts.ModuleJoined("late", "pid 7"))
    journal = story.write(tmp_path / "run")
    missing = run(journal, "--property", "eventually flambé achieved").stdout
    assert (
        "  it never did; not ended when the journal ends: flambé {2}\n  the story of flambé {2}"
        in missing
    )
    assert "no module handles it, " in missing
    ended = run(journal, "--property", "eventually bake suspended").stdout
    assert "  it never did; bake {1} was the last to end\n  the story of bake {1}" in ended


@pytest.mark.parametrize("text", HOLDS)
def test_property_that_holds_is_good(journal: Path, text: str) -> None:
    result = run(journal, "--property", text)
    assert result.exit_code == 0, result.output
    assert f"good: {text}" in result.stdout


@pytest.mark.parametrize(("text", "why"), BROKEN)
def test_broken_property_names_its_first_breach(journal: Path, text: str, why: str) -> None:
    result = run(journal, "--property", text)
    assert result.exit_code == 1
    assert f": {text}\n" in result.stdout
    assert any(line.startswith(why) for line in result.stdout.splitlines()), result.stdout


def test_malformed_property_text_is_refused(journal: Path, approve: Callable[..., None]) -> None:
    def refusal(text: str) -> str:
        with pytest.raises(BadProperty) as error:
            property_from(text)
        result = run(journal, "--property", text)
        assert (result.exit_code, str(error.value) in result.stderr) == (2, True)
        return str(error.value)

    approve("transcripts/bad_properties.txt", refusal)


def test_unknown_name_in_a_property_suggests_the_nearest(journal: Path) -> None:
    result = run(journal, "--property", "never failed of mvoe")
    assert result.exit_code == 2
    assert "the journal has no message 'mvoe': did you mean 'move'?" in result.stderr
    assert "no module 'leg'" in run(journal, "--property", "at most 1 handled by leg").stderr


FILE = """
from tca_tools.explore import World, achieved, at_most, before, begun, handled, never_stuck, planned_ahead, within
from tca_module import Command, Goal
import tca_tools.properties as properties

STEP, MOVE = Goal("step", int), Command("move", int)

def at_the_legs(world: World):
    return [seen for seen in world.messages if seen.module == "legs"]

def ever_recovering(world):
    return [task for task in world.run.tasks.values() if task.state == "recovering"]

ORDER = before(begun(STEP), begun(MOVE))
ONE = at_most(1, at_the_legs)
AHEAD = at_most(1, planned_ahead(STEP))
SOON = within(100, handled(STEP), begun(MOVE))
TOO_LATE = within(0.5, handled(STEP), achieved(STEP))
LEFT = never_stuck()
WRONG = before(achieved(MOVE), begun(STEP))
MORE = [properties.never(ever_recovering), properties.at_most(2, "handled of step")]
PROPERTIES = ["never stuck"]
"""


def test_properties_of_a_scenario_apply_to_a_real_run(journal: Path, tmp_path: Path) -> None:
    """The explorer and ``tca check`` accept the same property objects."""
    file = tmp_path / "properties.py"
    file.write_text(FILE)
    result = run(journal, file)
    assert result.exit_code == 1
    good = [
        line.removeprefix("good: ")
        for line in result.stdout.splitlines()
        if line.startswith("good: ")
    ]
    assert set(good[1:]) == {
        "step begun before move begun",
        "at most 1 at the legs",
        "at most 1 step planned ahead",
        "at most 2 handled of step",
        "move begun within 100 s of step handled",
        "never stuck",
    }
    assert "step achieved within 0.5 s of step handled\n  here " in result.stdout
    assert "move achieved before step begun\n  the second came first: step {4}\n" in result.stdout
    assert "never ever recovering\n  move {8}\n  the story of move {8}" in result.stdout


def test_property_file_imports_modules_beside_it(journal: Path, tmp_path: Path) -> None:
    (tmp_path / "walking_messages.py").write_text(
        "from tca_module import Goal\nSTEP = Goal('step', int)\n"
    )
    file = tmp_path / "properties.py"
    file.write_text(
        "from tca_tools.explore import at_most, planned_ahead\nfrom walking_messages import STEP\n"
        "AHEAD = at_most(1, planned_ahead(STEP))\n"
    )
    result = run(journal, file)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "good: at most 1 step planned ahead" in result.stdout


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("x = 1", "has no property"),
        ("1 / 0", "line 1: can't be run: ZeroDivisionError"),
        ("PROPERTIES = ['never']", "property 'never': unknown form"),
    ],
)
def test_invalid_property_file_is_refused(
    journal: Path, tmp_path: Path, content: str, why: str
) -> None:
    file = tmp_path / "properties.py"
    file.write_text(content)
    result = run(journal, file)
    assert result.exit_code == 2
    assert why in result.stderr


def test_predicate_that_raises_is_refused(journal: Path, tmp_path: Path) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        "from tca_tools.properties import never\nP = never(lambda world: world.nothing)\nP.words = 'it'"
    )
    result = run(journal, file)
    assert result.exit_code == 2
    assert "property 'it' can't be asked: AttributeError: " in result.stderr


@pytest.mark.parametrize("found", ["3", "'move'", "['move']", "1.5"])
def test_predicate_result_of_another_type_is_refused(
    journal: Path, tmp_path: Path, found: str
) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        f"from tca_tools.properties import never\ndef f(world): return {found}\nP = never(f)"
    )
    result = run(journal, file)
    assert (result.exit_code, result.stdout) == (2, "")
    assert (
        f"property 'never f' can't be asked: TypeError: it returned {found}: a predicate returns the"
        in result.stderr
    )


@pytest.mark.parametrize(
    "found",
    ["{t for t in world.tasks if t.message == 'walk'}", "world.tasks[0]", "iter(world.tasks)"],
)
def test_predicate_may_return_a_set_message_or_iterator(
    journal: Path, tmp_path: Path, found: str
) -> None:
    file = tmp_path / "properties.py"
    file.write_text(
        f"from tca_tools.properties import never\ndef f(world): return {found} if world.tasks else None\nP = never(f)"
    )
    assert "never f\n  walk {3}\n  the story of walk {3}" in run(journal, file).stdout


# --- counting and stories -------------------------------------------------------------------------


def chopping(tmp_path: Path) -> Path:
    """Return the journal of three chops for one slot. The event that ends a chop also begins the
    next one.
    """
    player = Player.of("cook: command chop", "user")
    for _ in range(3):
        player.task("user", "chop")
    for _ in range(3):
        player.reply("cook/1")
    return written(tmp_path / "chop.tcaj", [OPENED, *player.entries])


BEGUN_FILE = """
from tca_tools.explore import at_most, begun
from tca_module import Command

THEIRS = at_most(1, begun(Command("chop", int)))
PROPERTIES = ["at most 1 begun of chop", "at most 1 handled of chop", "at most 0 begun of chop"]
"""


def test_at_most_counts_ends_before_starts_of_the_same_event(tmp_path: Path) -> None:
    file = tmp_path / "properties.py"
    file.write_text(BEGUN_FILE)
    lines = run(chopping(tmp_path), file).stdout.splitlines()
    assert [line for line in lines if line.startswith("good: ")][1:] == [
        "good: at most 1 chop begun",
        "good: at most 1 begun of chop",
        "good: at most 1 handled of chop",
    ]
    assert "  here 1: chop {1}" in lines
    ended = run(tmp_path / "chop.tcaj", "--property", "at most 0 achieved of chop").stdout
    assert "here 1: chop {1}" in ended  # ends themselves are counted, too


def test_story_shown_is_that_of_a_named_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")  # wide enough for whole lines
    story = Story().module("user").at(1.0)
    for _ in range(10):
        story.queued(story.command("bake", "user"))
    run_of_ten = story.write(tmp_path / "run")
    first = run(run_of_ten, "--property", "never stuck").stdout
    assert (
        "not ended when the journal ends: bake {1}, bake {2}, bake {3}, bake {4}, bake {5}, bake {6} and 4 more\n"
        in first
    )
    assert "  the story of bake {1} until then:" in first
    newest = run(run_of_ten, "--property", "at most 9 queued of bake").stdout
    assert (
        "here 10: bake {10}, bake {1}, bake {2}, bake {3}, bake {4}, bake {5} and 4 more\n"
        in newest
    )
    assert "  the story of bake {10} until then:" in newest


# --- incomplete journals --------------------------------------------------------------------------


def test_unclosed_journal_is_good_and_reported_as_unclosed(tmp_path: Path) -> None:
    entries = walk()
    result = run(written(tmp_path / "cut.tcaj", entries[: len(entries) // 2], closed=False))
    assert result.exit_code == 0
    assert "it is not closed: central was stopped by force, or this is a copy" in result.stdout
    assert f"\ngood: {len(RULES)} rules\n" in result.stdout


def test_torn_last_entry_is_not_damage(tmp_path: Path) -> None:
    torn = tmp_path / "torn.tcaj"
    torn.write_bytes(encoded(walk())[:-7])
    result = run(torn)
    assert result.exit_code == 0
    assert f"no breach in the readable part: {len(RULES)} rules\n" in result.stdout
    assert "good:" not in result.stdout
    assert "are not a complete entry" in result.stderr


def test_damaged_journal_is_never_called_good(journal: Path) -> None:
    content = bytearray(journal.read_bytes())
    content[len(content) // 2] ^= 1
    journal.write_bytes(content)
    result = run(journal)
    assert result.exit_code == 1
    assert f"no breach in the readable part: {len(RULES)} rules\n" in result.stdout
    assert "good:" not in result.stdout
    assert f"{journal}, byte " in result.stderr


def test_middle_segment_reports_the_missing_segment(tmp_path: Path) -> None:
    entries = walk()
    first: Any = entries[0].facts[0]
    middle = len(entries) // 2
    opened = Entry(
        entries[middle].number,
        entries[middle].time,
        [first.__class__(JOURNAL_VERSION, "epoch", 2, 0.0, "0.1.0")],
    )
    result = run(written(tmp_path / "00000002.tcaj", [opened, *entries[middle:]]))
    assert result.exit_code == 0, result.output
    assert "  missing: 1 segment before segment 2; messages sent before" in result.stdout
    assert "no breach in the readable part: " in result.stdout


def test_check_refuses_wrong_arguments(journal: Path, tmp_path: Path) -> None:
    assert run(tmp_path / "x.tcaj").exit_code == 2
    assert run(journal, tmp_path / "x.py").exit_code == 2
    assert run(journal, journal).exit_code == 2
