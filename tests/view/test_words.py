"""The page's English is that of the other tools, and as much of it as has room."""

from pathlib import Path

import msgspec
import pytest
from tools.story import walking
from wire.test_waits_in_words import test_a_wait_in_words as of_waits
from wire.test_waits_in_words import test_durations as of_durations

from tca_wire.text.waits_in_words import in_words, several_in_words
from tca_wire.waits import WaitFor as Wait
from tca_wire.waits import WaitKind as Kind
from view.conftest import Look

pytestmark = pytest.mark.slow

WORDS = """async ([name, ...all]) => {
  const words = await import("/page/words.js"), { plain = String } = words;
  return all.map((one) => plain([words[name](one)].flat()));
}"""
SCAN = Wait(Kind.RUNNING, 7, "scan")
BUSY = Wait(Kind.RESOURCE, module="all of my legs", because=(Wait(Kind.RUNNING, 4, "move"),))
LOCKED = Wait(
    Kind.RESOURCE, module="legs", because=(Wait(Kind.LOCKED, name="reservation", module="eyes", because=(SCAN,)),)
)
CONSENT = Wait(Kind.REPLY, 141, "consent", because=(Wait(Kind.HANDLER),))
BAKES = [*(Wait(Kind.CONSTRAINT, number, "bake", 32) for number in range(3, 8)), Wait(Kind.PARENT, 1, "day", 8)]


def test_waits_and_durations_are_said_as_elsewhere(look: Look, tmp_path: Path) -> None:
    page = look(walking().write(tmp_path / "walk"))
    waits = [wait for wait, _ in of_waits.pytestmark[0].args[1]]  # type: ignore[attr-defined]
    assert page.evaluate(WORDS, ["waitsFor", *([msgspec.to_builtins(wait)] for wait in waits)]) == [
        *map(in_words, waits)
    ]
    assert page.evaluate(WORDS, ["waitsFor", msgspec.to_builtins(BAKES)]) == [several_in_words(BAKES)]
    lengths, told = zip(*of_durations.pytestmark[0].args[1], strict=True)  # type: ignore[attr-defined]
    assert page.evaluate(WORDS, ["duration", *lengths]) == [*told]


def test_of_a_note_that_has_no_room_goes_first_what_tells_least(look: Look, tmp_path: Path) -> None:
    page = look(walking().write(tmp_path / "walk"))
    legs = Wait(Kind.LOCK, 8, "lock", module="legs", because=(Wait(Kind.RUNNING, 4, "move"),))
    drill, stuck = (
        Wait(Kind.CONSTRAINT, 5, "drill", 32),
        {"thing": "tea {3}", "number": 3, "which": "no module handles"},
    )
    stuck |= {"that": "no module handles that", "others": 2}
    found = []
    for waits, end, room, told in (
        ([LOCKED], None, 65, "waits for legs, which eyes has reserved while handling scan {7}"),
        ([LOCKED], None, 45, "waits for legs, which eyes has reserved"),
        ([LOCKED], None, 30, "for legs, reserved by eyes"),
        ([legs], None, 50, "waits for the lock of legs {8}, busy with move {4}"),
        ([legs], None, 40, "for the lock of legs, busy with move {4}"),
        ([BUSY], None, 30, "for all …, busy with move {4}"),
        ([BUSY], None, 20, "for all of my legs …"),
        (BAKES, None, 80, "until bake {3} and 4 more are achieved, and until its parent day {1} is planned"),
        ([CONSENT], None, 44, "for consent {141}, which no module handles"),
        ([CONSENT], None, 30, "for consent {141}, which no …"),
        (
            [drill],
            stuck,
            101,
            "waits until drill {5} is achieved; in the end for tea {3}, which no module handles, and for 2 others",
        ),
        ([drill], stuck, 72, "until drill {5} is achieved; in the end for tea {3}, and for 2 others"),
        ([drill], stuck, 60, "until drill {5} …; in the end for tea {3}, and for 2 others"),
        ([drill], stuck, 54, "for tea {3}, which no module handles, and for 2 others"),
        ([drill], stuck, 30, "for tea {3}, and for 2 others"),
        (
            [Wait(Kind.SUBTASK, 3, "tea", 32)],
            stuck,
            90,
            "waits until tea {3} is achieved; no module handles that; in the end also for 2 others",
        ),
    ):
        note = {"how": "waits", "waits": msgspec.to_builtins(waits), "end": end}
        found.append((page.evaluate(ABRIDGED, [note, room]), told))
    assert [one for one, _ in found] == [told for _, told in found]


ABRIDGED = """async ([note, room]) => {
  const { abridged } = await import("/page/words.js");
  return abridged(note, "held", (...texts) => texts.filter(Boolean).join("; ").length <= room).parts.filter(Boolean).join("; ");
}"""
