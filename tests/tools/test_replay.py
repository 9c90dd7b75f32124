"""``tca replay``: the real application, driven by keys, without a screen; and the growth of the tree as text."""

import asyncio
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from rich.text import Text
from textual.pilot import Pilot
from textual.widgets import Input
from tools.runs import encoded, walk
from tools.story import Story, arcs, stumbling
from tools.test_coping import replacing
from tools.test_story import waiting_for_two

from tca_tools.replay.app import Replay
from tca_tools.replay.growth import growth_lines
from tca_tools.replay.panes import MessagesPane, StoryPane, TimeBar, TreePane
from tca_tools.replay.recording import Living, Recording
from tca_tools.replay.tree import Outline
from tca_wire import facts
from tca_wire.facts import Entry
from tca_wire.points import Moment

SIZE = (120, 40)


def play(app: Replay, act: Callable[[Pilot[None]], Awaitable[None]]) -> None:
    """Run the application with its own pilot, and do something with it."""

    async def run() -> None:
        async with app.run_test(size=SIZE) as pilot:
            await pilot.pause()
            await act(pilot)

    asyncio.run(run())


def replay(entries: list[Entry], **options: float) -> Replay:
    return Replay(Recording(entries), "walk", **options)


def tree_of(app: Replay) -> list[str]:
    """The lines of the tree pane, as drawn."""
    pane = app.query_one(TreePane)
    return [pane.render_line(line).text.rstrip() for line in range(len(pane.rows))]


def messages_of(app: Replay) -> str:
    return " ".join(str(app.query_one(MessagesPane).render()).split())


def story_of(app: Replay) -> str:
    return str(app.query_one(StoryPane).render())


# --- the application ------------------------------------------------------------------------------------------------


def test_forwards_and_backwards_message_by_message() -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        assert app.place == 0
        assert tree_of(app) == []
        trees = []
        for place in range(app.recording.last):
            trees.append(tree_of(app))
            await pilot.press("right")
            assert app.place == place + 1
        assert any("take steps {3}" in line and "planned" in line for tree in trees for line in tree)
        for tree in reversed(trees):
            await pilot.press("left")
            assert [line[:40] for line in tree_of(app)] == [line[:40] for line in tree]
        await pilot.press("left")
        assert app.place == 0

    play(app, act)


def test_the_next_failure_and_what_became_of_it() -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("f")
        assert app.recording.time(app.place) == 4.5
        assert app.selected == 7
        assert "failed move body {7}: terrain collision: leg 4 met\\x1b[31m rock" in messages_of(app)
        assert "move body {7}  failed" in story_of(app)
        assert any("move body {7}" in line and "failed" in line for line in tree_of(app))
        await pilot.press("f")
        assert "no failure follows" in str(app.query_one(TimeBar).render())
        await pilot.press("home", "F")
        assert "no failure before" in str(app.query_one(TimeBar).render())

    play(app, act)


@pytest.mark.parametrize(("top_fails", "colour"), [(False, "yellow"), (True, "red")])
def test_a_failure_after_which_the_run_went_on_has_a_colour_of_its_own(*, top_fails: bool, colour: str) -> None:
    app = replay(replacing(top_fails=top_fails).entries)

    def coloured(pane: type[TimeBar | MessagesPane | StoryPane], text: str) -> set[str]:
        """The colours of what holds a text."""
        shown = app.query_one(pane).render()
        assert isinstance(shown, Text)
        spans = [(shown.plain[one.start : one.end], str(one.style)) for one in shown.spans]
        return {style.removeprefix("bold ") for part, style in spans if text in part} & {"red", "yellow"}

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("f")
        assert (app.recording.failures, app.recording.bad) == ([app.place], {app.place} if top_fails else set())
        assert coloured(MessagesPane, "blind") == {colour}
        assert coloured(StoryPane, "failed: blind") == {colour}
        await pilot.press("home")
        assert coloured(TimeBar, "") == {colour}

    play(app, act)


def test_why_the_selected_task_waits() -> None:
    app = replay(stumbling().entries, at=2.5)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("slash", *"{10}", "enter")
        assert app.selected == 10
        assert "move body {10}  held" in story_of(app)
        story = " ".join(story_of(app).split())
        assert "waits until move leg {9} is achieved" in story
        assert "so far" not in story
        await pilot.press("g", *"3.4", "enter")
        story = " ".join(story_of(app).split())
        assert "being achieved, for 1.20 s" in story
        assert "being achieved, 1.200 s so far" in story
        selected = app.selected
        await pilot.press("up")
        assert app.selected != selected
        assert not app.follows

    play(app, act)


def test_a_story_tells_how_long_something_lasts_so_far_and_not_yet_how_it_ends() -> None:
    app = replay(stumbling().entries, at=4.2)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("slash", *"{7}", "enter")
        await pilot.press("g", *"4.2", "enter")
        assert "handled by controller, 0.000 s so far" not in story_of(app)
        story = " ".join(story_of(app).split())
        assert "failed" not in story
        assert "so far" in story
        await pilot.press("end")
        assert "handled by controller: failed, 1.100 s" in story_of(app)

    play(app, act)


def test_a_story_says_nothing_that_was_not_known_then() -> None:
    app = replay(waiting_for_two().entries, at=1.0)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("slash", *"{3}", "enter")
        for moment, why in (
            ("1", "until move {1} is achieved and until look {2} is achieved"),
            ("2", "until look {2}"),
        ):
            await pilot.press("g", *moment, "enter")
            _, _, sentences = " ".join(story_of(app).split()).partition("sent by user")
            assert f"held, {why}" in sentences
        await pilot.press("end")
        assert "held, until look {2} is achieved, 2.000 s" in " ".join(story_of(app).split())

    play(app, act)


def test_search_goes_from_one_to_the_next() -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("slash", *"STEPS", "enter")
        assert app.selected == 2
        await pilot.press("slash", *"move", "enter")
        assert app.selected == 6
        await pilot.press("n")
        assert app.selected == 9
        await pilot.press("N")
        assert app.selected == 7
        await pilot.press("slash", *"unheard", "enter")
        assert "no task 'unheard' is sent later" in str(app.query_one(TimeBar).render())
        place = app.place
        await pilot.press("slash", *"2", "enter")  # it is there: it is chosen as it is now
        assert (app.selected, app.place) == (2, place)
        await pilot.press("home", "slash", *"{9}", "enter")  # it is not there yet
        assert (app.selected, app.place > 0) == (9, True)

    play(app, act)


def test_going_to_a_time() -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("g", *"2.3", "enter")
        assert app.recording.time(app.place) == 2.2
        await pilot.press("g", *"100", "enter")
        assert app.place == app.recording.last
        assert "the journal ends at 5.000 s" in str(app.query_one(TimeBar).render())
        await pilot.press("g", *"soon", "enter")
        assert "'soon' is no time" in str(app.query_one(TimeBar).render())
        await pilot.press("g")
        assert isinstance(app.focused, Input)
        await pilot.press("1", "left", "9")  # the arrow moves within what is typed
        assert app.focused.value == "91"
        await pilot.press("escape")
        assert not isinstance(app.focused, Input)
        await pilot.press("end")
        assert app.place == app.recording.last

    play(app, act)


def test_reasons_are_shown_where_names_are_long_and_what_is_cut_says_so() -> None:
    story = Story().module("cook", "dinner").at(1.0)
    dinner = story.goal("dinner for very many guests, with music", "waiter")
    story.delivered(dinner, "cook")
    for number in range(60):
        one = story.at(2.0 + number).command("bake a cake that is larger than the oven", "cook", dinner)
        story.say(facts.Failed(one, "burnt", "nobody looked after it, and it was very hot in there"))
    app = replay(story.entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("end")
        shown = app.query_one(TreePane).scrollable_content_region.width
        lines = [line for line in tree_of(app) if "burnt" in line]
        assert lines
        assert all("burnt: nobody loo" in line and line[:shown].endswith("…") for line in lines)

    play(app, act)


def test_it_plays_at_any_speed_and_backwards() -> None:
    app = replay(stumbling().entries, speed=5000)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("space")
        while app.is_playing:
            await pilot.pause(0.02)
        assert app.place == app.recording.last
        await pilot.press("r", "space")
        while app.is_playing:
            await pilot.pause(0.02)
        assert app.place == 0
        await pilot.press("minus", "minus")
        assert app.speed == 500
        await pilot.press("plus")
        assert app.speed == 1000

    play(app, act)


def test_time_is_chosen_with_the_mouse_and_so_are_tasks() -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.click(TimeBar, offset=(60, 1))
        assert 2.0 < app.recording.time(app.place) < 3.0
        line = next(number for number, text in enumerate(tree_of(app)) if "take steps {3}" in text)
        await pilot.click(TreePane, offset=(12, line + 1))
        assert app.selected == 3

    play(app, act)


def test_a_task_is_closed_and_opened() -> None:
    app = replay(stumbling().entries, at=3.0)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("slash", *"{2}", "enter")
        await pilot.press("g", *"3", "enter")
        assert any("─ move leg {6}" in line for line in tree_of(app))
        await pilot.press("enter")
        assert not any("─ move leg {6}" in line for line in tree_of(app))
        assert any("take steps {2} + 2" in line for line in tree_of(app))
        await pilot.press("enter")
        assert any("move leg {6}" in line for line in tree_of(app))

    play(app, act)


@pytest.mark.parametrize("keys", [["q"], ["ctrl+c"], ["slash", "ctrl+c"], ["slash", *"unheard", "enter", "q"],
                                  ["slash", "enter", "q"], ["slash", "q", "escape", "q"], ["g", *"x", "ctrl+j", "q"]])  # fmt: skip
def test_how_it_ends(keys: list[str]) -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press(*keys[:-1])
        assert app.return_code is None
        await pilot.press(keys[-1])

    play(app, act)
    assert app.return_code == 0


def test_an_empty_run() -> None:
    app = replay(Story().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("right", "f", "space", "up", "enter", "end")
        assert app.place == 0

    play(app, act)


# --- what is shown of many -------------------------------------------------------------------------------------------


def crowd(tops: int) -> Recording:
    """Very many goals, of which one in a thousand lives on."""
    story = Story().module("user").module("planner", "walk")
    for number in range(tops):
        goal = story.at(1.0 + number).goal("walk", "user")
        story.delivered(goal, "planner").reached(goal, Moment.START_ACHIEVING).returned(goal)
        if number % 1000:
            story.reached(goal, Moment.END_PLANNING, Moment.END_ACHIEVING)
    return Recording(story.entries)


def test_of_very_many_tasks_a_few_are_shown() -> None:
    recording = crowd(5_000)
    outline = Outline(recording)
    rows = outline.rows(recording.then(recording.last))
    assert outline.living == 5
    assert len(rows) < 20
    assert sum(row.folded or 1 for row in rows) == 5_000
    assert {1, 1001, 2001, 3001, 4001, 5000} <= {row.task for row in rows}
    chosen = outline.rows(recording.then(recording.last), selected=2500)
    assert 2500 in {row.task for row in chosen}


def test_what_lives_is_the_same_however_one_gets_there() -> None:
    recording = Recording(walk())
    walking, times = Living(recording.past), recording.past.times
    for place in [*range(len(times)), *reversed(range(len(times))), 40, 3, 60]:
        walking.move(times[place])
        jumped = Living(recording.past)
        jumped.move(times[place])
        assert {key: set(value) for key, value in walking.below.items()} == {
            key: set(value) for key, value in jumped.below.items()
        }
        then = recording.then(place)
        assert walking.number == sum(Moment.END_ACHIEVING not in task.reached for task in then.tasks.values())


def test_deep_trees_are_drawn() -> None:
    story = Story().module("user").module("planner", "walk")
    parent = 0
    for _ in range(3_000):
        parent = story.goal("walk", "user", parent)
    recording = Recording(story.entries)
    rows = Outline(recording).rows(recording.then(recording.last))
    assert len(rows) == 3_000
    assert max(len(row.guides) for row in rows) < 60


# --- as text ---------------------------------------------------------------------------------------------------------


def test_the_growth_as_text(expect: Callable[[str, str], None]) -> None:
    lines = growth_lines(Recording(stumbling().entries), 0.0, None)
    expect("replay_stumbling", "\n".join(lines) + "\n")


def test_without_a_terminal_it_is_text(tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    command = [sys.executable, "-m", "tca_tools.replay", str(path), "--at", "40"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60, stdin=subprocess.DEVNULL)
    assert done.stdout.split(maxsplit=1)[0] == "42.000"
    assert ": killed, enough" in done.stdout
    assert "\x1b" not in done.stdout


def test_a_damaged_journal_is_replayed_but_for_the_damage(tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    content = bytearray(encoded(walk()))
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    done = subprocess.run([sys.executable, "-m", "tca_tools.replay", str(path), "--text"], capture_output=True, text=True,
                          check=False, timeout=60)  # fmt: skip
    assert done.returncode == 1
    assert "walk {3}: handling" in done.stdout
    assert ": a damaged entry is left out: " in done.stderr


@pytest.mark.parametrize("speed", ["0", "-1", "fast"])
def test_a_speed_that_is_none(speed: str) -> None:
    command = [sys.executable, "-m", "tca_tools.replay", "--speed", speed]
    assert subprocess.run(command, capture_output=True, check=False, timeout=60).returncode == 2


def test_the_arcs_have_waits() -> None:
    lines = list(growth_lines(Recording(arcs().entries), 0.0, 70))
    assert lines
    assert any("waits" in line for line in lines)
