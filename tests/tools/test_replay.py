"""``tca replay``: the real application, driven by keys without a screen, and its text form."""

import asyncio
import signal
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import Result
from integration.terminal import Terminal, terminal
from rich.text import Text
from textual.pilot import Pilot
from textual.widgets import RichLog, Static
from tools.runs import encoded, walk
from tools.story import QUERY, Story, made, stumbling

from tca_tools.replay.app import Replay
from tca_tools.replay.growth import growth_lines
from tca_tools.replay.panes import MessagesPane, Question, StoryPane, TimeBar, TreePane
from tca_tools.replay.recording import Recording
from tca_tools.replay.tree import rows_at
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import Moment

Tca = Callable[..., Result]
Act = Callable[["Player"], Awaitable[None]]


TRACEBACK = "ZeroDivisionError: division by zero\nTraceback (most recent call last):\n  File walk.py, line 3\n    1 / 0\n"


class Player:
    """The application with its visible texts."""

    def __init__(self, app: Replay, pilot: Pilot[None]) -> None:
        self.app = app
        self.pilot = pilot
        self.press = pilot.press

    async def ask(self, key: str, text: str) -> None:
        """Press a key that asks a question, and type an answer."""
        await self.press(key)
        self.app.query_one(Question).value = text
        await self.press("enter")

    @property
    def time(self) -> float:
        return self.app.recording.time(self.app.place)

    @property
    def tree(self) -> list[str]:
        """Return the lines of the tree pane, as drawn."""
        pane = self.app.query_one(TreePane)
        return [pane.render_line(line).text.rstrip() for line in range(len(pane.rows))]

    @property
    def heading(self) -> str:
        return str(self.app.query_one(TimeBar).render())

    @property
    def messages(self) -> str:
        return " ".join(str(self.app.query_one(MessagesPane).render()).split())

    @property
    def story(self) -> str:
        """Return the visible words of the story pane."""
        log = self.app.query_one(RichLog)
        lines = [log.render_line(line).text for line in range(log.size.height)]
        return " ".join(
            " ".join([str(self.app.query_one("#standing", Static).render()), *lines]).split()
        )

    def coloured(self, text: str) -> set[str]:
        """Return the colours of a text in all panes."""
        log = self.app.query_one(RichLog)
        drawn = [(one.text, str(one.style)) for line in log.lines for one in line]
        for pane in (self.app.query_one(TimeBar), self.app.query_one(MessagesPane)):
            shown = pane.render()
            assert isinstance(shown, Text)
            drawn += [(shown.plain[one.start : one.end], str(one.style)) for one in shown.spans]
        return {one for part, style in drawn if text in part for one in style.split()} & {
            "red",
            "yellow",
        }


def play(
    entries: list[Entry],
    act: Act,
    size: tuple[int, int] = (120, 32),
    *,
    at: float | None = 0.0,
    speed: float = 1.0,
) -> Replay:
    """Run the application and an action on it."""
    app = Replay(Recording(entries), "walk", speed=speed, at=at)
    app.animation_level = "none"

    async def run() -> None:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await act(Player(app, pilot))

    asyncio.run(run())
    return app


def test_arrow_keys_step_forwards_and_backwards() -> None:
    async def act(player: Player) -> None:
        assert (player.app.place, player.tree) == (0, [])
        trees = []
        for place in range(player.app.recording.last):
            trees.append(player.tree)
            await player.press("right")
            assert player.app.place == place + 1
        assert any(
            "take steps {3}" in line and "planned" in line for tree in trees for line in tree
        )
        for tree in reversed(trees):
            await player.press("left")
            assert [line[:40] for line in player.tree] == [line[:40] for line in tree]
        await player.press("left")
        assert player.app.place == 0

    play(stumbling().entries, act)


def test_f_key_selects_the_next_failure() -> None:
    async def act(player: Player) -> None:
        await player.press("f")
        assert (player.time, player.app.selected) == (4.5, 7)
        assert "failed move body {7}: terrain collision: leg 4 met\\x1b[31m rock" in player.messages
        assert player.story.count("terrain collision: leg 4 met") == 1
        assert any("move body {7}" in line and "failed" in line for line in player.tree)
        await player.press("f")
        assert "no later failure" in player.heading
        await player.press("home", "F")
        assert "no earlier failure" in player.heading

    play(stumbling().entries, act)


def test_failed_query_selects_the_task_that_sent_it() -> None:
    """In this event, another fact comes first and names another task."""
    story = Story().module("lab", "analyse").at(1.0)
    other, goal = story.goal("rest", "user"), story.goal("analyse", "user")
    story.delivered(goal, "lab").at(2.0)
    question = story.received("where", QUERY, "lab", origin=goal)
    story.delivered(question, "lab", "eyes").at(3.0).queued(other).failed(
        question, "dark", "no light"
    ).at(4.0)

    async def act(player: Player) -> None:
        await player.press("f")
        assert (player.time, player.app.selected) == (3.0, goal)

    play(story.entries, act)


@pytest.mark.parametrize(("top_fails", "colour"), [(False, "yellow"), (True, "red")])
def test_handled_failure_is_yellow_and_unhandled_is_red(*, top_fails: bool, colour: str) -> None:
    async def act(player: Player) -> None:
        await player.press("f")
        assert player.app.recording.failures == {player.app.place: top_fails}
        assert player.coloured("blind") == {"red"}  # its fate is not known yet
        selected = player.app.selected
        await player.press("end")
        await player.ask("slash", str(selected))
        assert player.coloured("failed: blind") == {colour}
        await player.press("home")
        assert player.coloured("─") == {colour}

    play(made("not_replaced" if top_fails else "replaced").entries, act)


def test_story_shows_the_wait_so_far_without_its_end() -> None:
    async def act(player: Player) -> None:
        await player.ask("slash", "{10}")
        assert player.app.selected == 10
        assert player.story.startswith("move body {10} held waits until move leg {9} is achieved")
        assert "so far" not in player.story
        await player.ask("g", "3.4")
        assert "being achieved, for 1.2 s" in player.story
        assert "being achieved, 1.200 s so far" in player.story
        await player.press("up")
        assert player.app.selected != 10
        await player.ask("g", "4.2")
        await player.ask("slash", "{7}")
        assert "handled by controller, 0.000 s so far" not in player.story
        assert ("failed" in player.story, "so far" in player.story) == (False, True)
        await player.press("end")
        assert "handled by controller: failed, 1.100 s" in player.story

    play(stumbling().entries, act, at=2.5)


def test_story_omits_reasons_not_yet_known() -> None:
    async def act(player: Player) -> None:
        await player.ask("slash", "{3}")
        for time, why in (("1", "until move {1} is achieved"), ("2", "until look {2}")):
            await player.ask("g", time)
            assert f"held, {why}" in player.story.partition("sent by user")[2]
        await player.press("end")
        assert "held, until look {2} is achieved, 2.000 s" in player.story

    play(made("waiting_for_two").entries, act, at=1.0)


@pytest.mark.soak
def test_n_key_moves_between_search_results() -> None:
    async def act(player: Player) -> None:
        await player.ask("slash", "STEPS")
        assert player.app.selected == 2
        await player.ask("slash", "move")
        selected = [player.app.selected]
        for key in "nN":
            await player.press(key)
            selected.append(player.app.selected)
        assert selected == [6, 9, 7]
        await player.ask("slash", "unheard")
        assert "no task or failure 'unheard'" in player.heading
        place = player.app.place
        await player.ask("slash", "2")  # it exists at this time: the time stays
        assert (player.app.selected, player.app.place) == (2, place)
        await player.press("home")
        await player.ask("slash", "{9}")  # it comes later: the time moves on
        assert (player.app.selected, player.app.place > 0) == (9, True)

    play(stumbling().entries, act)


@pytest.mark.soak
def test_search_finds_failures_and_wraps_around() -> None:
    async def act(player: Player) -> None:
        await player.ask("slash", "Leg 4 met")
        assert (player.time, player.app.selected) == (4.5, 7)
        await player.ask("slash", "take")
        assert (player.app.selected, "search continued from the start" in player.heading) == (
            2,
            True,
        )
        await player.press("N")
        assert (player.app.selected, "search continued from the end" in player.heading) == (4, True)
        await player.press("home")
        await player.ask("slash", "collision")  # the earlier one of a name and a failure
        assert player.time == 4.5
        await player.press("n")
        assert player.time == 4.5

    play(stumbling().entries, act)


def test_run_opens_at_its_end_and_plays_from_its_start() -> None:
    async def act(player: Player) -> None:
        assert player.app.place == player.app.recording.last
        assert any("move body {7}" in line and "failed" in line for line in player.tree)
        await player.press("space", "space")
        assert player.app.place < player.app.recording.last

    play(stumbling().entries, act, at=None, speed=0.01)


def test_page_keys_and_help_panel_work_in_replay() -> None:
    async def act(player: Player) -> None:
        await player.press("right_square_bracket")
        assert player.time == 4.5
        await player.press("end", "left_square_bracket")
        assert player.time == 4.5
        await player.press("question_mark")
        await player.pilot.pause()
        assert player.app.screen.query("HelpPanel")
        await player.press("question_mark")
        await player.pilot.pause()
        assert not player.app.screen.query("HelpPanel")

    play(stumbling().entries, act)


def test_traceback_is_whole_in_a_story_and_one_line_elsewhere() -> None:
    async def act(player: Player) -> None:
        await player.press("end")
        log = player.app.query_one(RichLog)
        lines = [line.text.strip() for line in log.lines]
        place = lines.index("Traceback (most recent call last):")
        assert lines[place + 1 : place + 3] == ["File walk.py, line 3", "1 / 0"]
        assert "walk {1}: handler error: ZeroDivisionError: division by zero ..." in player.messages
        assert "\\n" not in player.messages + player.story

    story = Story().module("legs", "walk").at(1.0)
    walk_ = story.goal("walk", "x", to="legs")
    story.at(2.0).failed(walk_, "handler error", TRACEBACK)
    play(story.entries, act, (200, 40))


def test_g_key_and_mouse_go_to_a_time() -> None:
    async def act(player: Player) -> None:
        await player.ask("g", "2.3")
        assert player.time == 2.2
        await player.ask("g", "100")
        assert player.app.place == player.app.recording.last
        assert "the journal ends at 5.000 s" in player.heading
        await player.ask("g", "soon")
        assert "'soon' is not a time" in player.heading
        await player.press("g", "1", "left", "9")  # the arrow moves the cursor of the input
        assert player.app.query_one(Question).value == "91"
        await player.press("escape", "home")
        assert player.app.place == 0
        await player.pilot.click(TimeBar, offset=(60, 1))
        assert 2.0 < player.time < 3.0

    play(stumbling().entries, act)


def test_click_selects_a_task_and_enter_folds_it() -> None:
    async def act(player: Player) -> None:
        line = next(number for number, text in enumerate(player.tree) if "─ take steps {2}" in text)
        await player.pilot.click(TreePane, offset=(12, line + 1))
        assert player.app.selected == 2
        assert any("─ move leg {6}" in line for line in player.tree)
        await player.press("enter")
        assert not any("move leg {6}" in line for line in player.tree)
        assert any("└─ + 2 tasks" in line for line in player.tree)
        await player.press("enter")
        assert any("move leg {6}" in line for line in player.tree)

    play(stumbling().entries, act, at=3.0)


def test_reason_beside_a_long_name_is_cut_with_an_ellipsis() -> None:
    story = Story().module("cook", "dinner").at(1.0)
    dinner = story.goal("dinner for very many guests, with music", "waiter", to="cook")
    for number in range(60):
        one = story.at(2.0 + number).command(
            "bake a cake that is larger than the oven", "cook", dinner
        )
        story.say(
            facts.Failed(one, "burnt", "nobody looked after it, and it was very hot in there")
        )

    async def act(player: Player) -> None:
        await player.press("end")
        shown = player.app.query_one(TreePane).scrollable_content_region.width
        lines = [line for line in player.tree if "burnt" in line]
        assert lines
        assert all("burnt: nobody loo" in line and line[:shown].endswith("…") for line in lines)

    play(story.entries, act)


def test_replay_plays_both_ways_and_changes_speed() -> None:
    async def act(player: Player) -> None:
        for keys, end in ((("space",), player.app.recording.last), (("r", "space"), 0)):
            await player.press(*keys)
            while player.app.is_playing:
                await player.pilot.pause(0.02)
            assert player.app.place == end
        await player.press("minus", "minus")
        assert player.app.speed == 500
        await player.press("plus")
        assert player.app.speed == 1000

    play(stumbling().entries, act, speed=5000)


@pytest.mark.parametrize(
    "keys",
    [
        ["q"],
        ["slash", "ctrl+c"],
        pytest.param(["slash", "q", "escape", "q"], marks=pytest.mark.soak),
        pytest.param(["right", "f", "space", "up", "enter", "end", "q"], marks=pytest.mark.soak),
    ],
)
def test_quit_keys_end_the_replay(keys: list[str]) -> None:
    async def act(player: Player) -> None:
        await player.press(*keys[:-1])
        assert player.app.return_code is None
        await player.press(keys[-1])

    assert play(Story().entries, act).return_code == 0


def test_long_story_shows_its_end_and_scrolls_to_its_start() -> None:
    story = Story().module("cook", "bake").at(1.0)
    cake = story.command(
        "bake", "a waiter with a name that is far too long for one line of a pane", to="cook"
    )
    for number in range(30):
        asked = story.at(2.0 + number).received(
            "is there any room left in the oven", QUERY, "cook", origin=cake
        )
        story.at(2.5 + number).say(facts.Answered(asked))
    story.at(40.0).achieved(cake)

    async def act(player: Player) -> None:
        await player.press("end")
        assert player.story.endswith("achieved")
        assert "sent by a waiter" not in player.story
        await player.press(*["pageup"] * 20)
        assert "sent by a waiter" in player.story
        await player.press("pagedown")
        assert "sent by a waiter" not in player.story
        assert "bake {1}" in player.story

    play(story.entries, act)


@pytest.mark.parametrize(("width", "is_below"), [(60, True), (130, False)])
def test_story_is_below_the_tree_on_a_narrow_terminal(width: int, is_below: bool) -> None:
    async def act(player: Player) -> None:
        tree, story = player.app.query_one(TreePane).region, player.app.query_one(StoryPane).region
        assert (story.y >= tree.bottom, story.x >= tree.right) == (is_below, not is_below)

    play(stumbling().entries, act, (width, 20))


# --- very many tasks ------------------------------------------------------------------------------


def test_replay_folds_most_of_5000_tasks() -> None:
    """One goal in a thousand stays open, so 5 of the goals are not folded."""
    story = Story().module("user").module("planner", "walk")
    for number in range(5_000):
        goal = story.at(1.0 + number).goal("walk", "user", to="planner", begins=True)
        story.returned(goal)
        if number % 1000:
            story.reached(goal, Moment.END_PLANNING, Moment.END_ACHIEVING)
    recording = Recording(story.entries)
    at = recording.at(recording.last)
    rows = rows_at(at, 0, {})
    assert [
        recording.count_open_tasks(recording.at(place)) for place in (recording.last, 2001, 0)
    ] == [
        5,
        3,
        0,
    ]
    assert len(rows) < 20
    assert sum(row.folded or 1 for row in rows) == 5_000
    assert {1, 1001, 2001, 3001, 4001, 5000} <= {row.task.id for row in rows if row.task}
    assert 2500 in {row.task.id for row in rows_at(at, 2500, {}) if row.task}


def test_replay_cuts_a_deep_tree_at_3000_rows() -> None:
    story, parent = Story().module("user").module("planner", "walk"), 0
    for _ in range(3_100):
        parent = story.goal("walk", "user", parent)
    recording = Recording(story.entries)
    rows = rows_at(recording.at(recording.last), 0, {})
    assert [row.is_rest for row in rows] == [False] * 3_000 + [True]


# --- as text --------------------------------------------------------------------------------------


def test_replay_text_matches_its_transcript(expect: Callable[[str, str], None]) -> None:
    lines = growth_lines(Recording(stumbling().entries), 0.0, None)
    expect("replay_stumbling", "\n".join(lines) + "\n")


def test_replay_without_a_terminal_prints_text(tca: Tca, tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    done = tca("replay", path, "--at", "40")
    assert done.stdout.split(maxsplit=1)[0] == "42.000"
    assert (": killed, enough" in done.stdout, "\x1b" in done.stdout) == (True, False)
    content = bytearray(encoded(walk()))
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    done = tca("replay", path, "--text")
    assert done.exit_code == 1
    assert "walk {3}: handling" in done.stdout
    assert ": a damaged entry is left out: " in done.stderr


@pytest.mark.parametrize("speed", ["0", "-1", "fast"])
def test_invalid_speed_is_refused(tca: Tca, speed: str) -> None:
    assert tca("replay", "--speed", speed).exit_code == 2


# --- on a real terminal ---------------------------------------------------------------------------


SOON = 30.0
ENTER, LINE_END, CONTROL_C = "\r", "\n", "\x03"


@contextmanager
def replaying(path: Path) -> Iterator[Terminal]:
    command = [
        sys.executable,
        "-c",
        "from tca_tools.command_line import main; main()",
        "replay",
        str(path),
    ]
    with terminal(command) as shown:
        shown.shows("task tree")
        yield shown


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    return path


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize(
    "keys",
    [
        CONTROL_C,
        "/nothing like it" + ENTER + "q",  # typed without pauses
        pytest.param("gsoon" + LINE_END + "q", marks=pytest.mark.soak),
    ],
)
def test_quit_keys_end_the_replay_on_a_terminal(run: Path, keys: str) -> None:
    with replaying(run) as shown:
        shown.type(keys.encode())
        assert shown.ends() == 0


@pytest.mark.soak
@pytest.mark.slow
def test_q_in_a_search_does_not_quit_but_sigint_does(run: Path) -> None:
    with replaying(run) as shown:
        shown.type(b"/quest\r")
        shown.shows("no task or failure 'quest'")
        shown.process.send_signal(signal.SIGINT)
        assert shown.ends() in (0, 130)


@pytest.mark.slow
def test_replay_ends_when_its_terminal_vanishes(run: Path) -> None:
    """The replay is in another session, so no signal arrives."""
    with replaying(run) as shown:
        shown.vanish()
        assert shown.process.wait(timeout=SOON) == -signal.SIGHUP
