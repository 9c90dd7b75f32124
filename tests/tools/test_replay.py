"""``tca replay``: the real application, driven by keys, without a screen."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from rich.text import Text
from textual.pilot import Pilot
from textual.widgets import Input
from tools.story import QUERY, Story, stumbling
from tools.test_coping import replacing
from tools.test_story import waiting_for_two

from tca_tools.replay.app import Replay
from tca_tools.replay.panes import Keys, MessagesPane, StoryPane, TimeBar, TreePane
from tca_tools.replay.recording import Recording
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import Moment
from tca_wire.vocabulary import Outcome

SIZE = (120, 40)


def play(app: Replay, act: Callable[[Pilot[None]], Awaitable[None]], size: tuple[int, int] = SIZE) -> None:
    """Run the application with its own pilot, and do something with it."""

    async def run() -> None:
        async with app.run_test(size=size) as pilot:
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


def test_of_a_question_that_fails_who_asked_is_shown() -> None:
    """Not what another fact of the same event names first."""
    story = Story().module("lab", "analyse").at(1.0)
    other, goal = story.goal("rest", "user"), story.goal("analyse", "user")
    story.delivered(goal, "lab").at(2.0)
    question = story.received("where", QUERY, "lab", origin=goal)
    story.delivered(question, "lab", "eyes").at(3.0).queued(other)
    story.returned(question, Outcome.FAILED).say(facts.Failed(question, "dark", "no light")).at(4.0)
    app = replay(story.entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("f")
        assert (app.recording.time(app.place), app.selected) == (3.0, goal)

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
        assert coloured(MessagesPane, "blind") == {"red"}  # that the walk would be achieved is not known yet
        assert coloured(StoryPane, "failed: blind") == {"red"}
        selected = app.selected
        await pilot.press("end", "slash", *str(selected), "enter")
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
        assert "being achieved, for 1.2 s" in story
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
        assert "handled by controller: failed, 1.100 s" in " ".join(story_of(app).split())

    play(app, act)


def test_a_story_says_nothing_that_was_not_known_then() -> None:
    app = replay(waiting_for_two().entries, at=1.0)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("slash", *"{3}", "enter")
        for moment, why in (
            ("1", "until move {1} is achieved"),
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


def test_all_of_a_long_story_can_be_read_and_the_newest_of_it_is_seen() -> None:
    """Sentences that take several lines leave room for the last one."""
    story = Story().module("cook", "bake").at(1.0)
    cake = story.command("bake", "a waiter with a name that is far too long for one line of a pane")
    story.delivered(cake, "cook")
    for number in range(30):
        asked = story.at(2.0 + number).received("is there any room left in the oven", QUERY, "cook", origin=cake)
        story.at(2.5 + number).say(facts.Answered(asked))
    app = replay(story.at(40.0).returned(cake).reached(cake, Moment.END_ACHIEVING).entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.press("end")
        assert "achieved" in story_of(app).splitlines()[-1]
        height = app.query_one(StoryPane).size.height
        assert len(story_of(app).splitlines()) <= height
        assert "sent by a waiter" not in " ".join(story_of(app).split())
        for _ in range(12):
            await pilot.press("pageup")
        assert "sent by a waiter" in " ".join(story_of(app).split())
        await pilot.press("pagedown")
        assert "sent by a waiter" not in " ".join(story_of(app).split())
        assert "bake {1}" in story_of(app)

    play(app, act)


@pytest.mark.parametrize("width", [60, 80, 130, 200])
def test_the_keys_that_are_named_are_whole_and_the_one_that_quits_is_among_them(width: int) -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.pause()
        seen = [key for key in app.query_one(Keys).children if key.visible]
        assert all(key.virtual_region.right <= width for key in seen)
        assert {"q", "space", "left", "right"} <= {getattr(key, "key", "") for key in seen}
        assert len(seen) < len(app.query_one(Keys).children) or width == 200

    play(app, act, (width, 40))


@pytest.mark.parametrize(("width", "is_below"), [(60, True), (130, False)])
def test_where_there_is_little_room_the_story_stands_below_the_tree(width: int, is_below: bool) -> None:
    app = replay(stumbling().entries)

    async def act(pilot: Pilot[None]) -> None:
        await pilot.pause()
        tree, story = app.query_one(TreePane).region, app.query_one(StoryPane).region
        assert (story.y >= tree.bottom, story.x >= tree.right) == (is_below, not is_below)

    play(app, act, (width, 20))
