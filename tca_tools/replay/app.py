"""The replay on the terminal: what the keys do, and when time passes. Knows the recording and the panes."""

from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical

from tca_tools.replay.panes import Keys, MessagesPane, Question, StoryPane, TimeBar, TreePane
from tca_tools.replay.recording import Recording
from tca_tools.replay.tree import Outline
from tca_wire.journal.facts import Failed
from tca_wire.text.facts_in_words import subject_of
from tca_wire.text.printable import printable

FRAMES = 15
"""How often the screen is drawn in a second while time passes."""
SPEEDS = (0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 100.0, 500.0, 1000.0, 5000.0)
_FAR = 20
_LEAST_BESIDE = 90
"""Columns: with fewer the story stands below the tree."""
_OF_THE_TREE = {"step", "fold", "select", "go_to_start", "go_to_end", "ask_time", "ask_name"}
"""What keys do at once, but not while something is typed."""


class Replay(App[None]):
    """A run, message by message."""

    CSS = """
    #bar { height: 2; padding: 0 1; background: $panel; }
    #main { height: 2fr; }
    #tree { width: 2fr; border: round $primary-darken-2; padding: 0 1; scrollbar-size-horizontal: 0; }
    #tree:focus { border: round $primary; }
    #story { width: 1fr; border: round $primary-darken-2; padding: 0 1; }
    #messages { height: 1fr; border: round $primary-darken-2; padding: 0 1; }
    .-narrow #main { layout: vertical; height: 3fr; }
    .-narrow #tree, .-narrow #story { width: 100%; height: 1fr; }
    #ask { display: none; height: 3; }
    #ask.asked { display: block; }
    """
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (_LEAST_BESIDE, "-wide")]  # noqa: RUF012 - the base class has it so
    BINDINGS: ClassVar = [
        Binding("q", "quit", "quit"),
        Binding("space", "play", "play/pause"),
        Binding("right", "step(1)", "next message", priority=True),
        Binding("left", "step(-1)", "before", priority=True),
        Binding("plus,equals_sign", "speed(1)", "faster", key_display="+"),
        Binding("minus", "speed(-1)", "slower", key_display="-"),
        Binding("r", "turn", "backwards"),
        Binding("f", "failure(1)", "next failure"),
        Binding("F", "failure(-1)", "failure before", show=False),
        Binding("g", "ask_time", "go to time", priority=True),
        Binding("slash", "ask_name", "search", key_display="/", priority=True),
        Binding("n", "search(1)", "next found", show=False),
        Binding("N", "search(-1)", "found before", show=False),
        Binding("enter", "fold", "open/close", priority=True),
        Binding("up", "select(-1)", show=False, priority=True),
        Binding("down", "select(1)", show=False, priority=True),
        Binding("shift+right,ctrl+right", f"step({_FAR})", show=False),
        Binding("shift+left,ctrl+left", f"step({-_FAR})", show=False),
        Binding("pageup", "scroll_story(1)", "story back", show=False, priority=True),
        Binding("pagedown", "scroll_story(-1)", "story on", show=False, priority=True),
        Binding("home", "go_to_start", show=False, priority=True),
        Binding("end", "go_to_end", show=False, priority=True),
        Binding("ctrl+c", "quit", show=False, priority=True),
        Binding("escape", "stop_asking", show=False),
    ]

    ENABLE_COMMAND_PALETTE = False

    def __init__(self, recording: Recording, name: str, *, speed: float = 1.0, at: float | None = None) -> None:
        super().__init__()
        self.title = printable(name)
        self.recording = recording
        self.outline = Outline(recording)
        self.place = 0 if at is None else recording.place_of(at)
        self.speed = speed
        self.direction = 1
        self.is_playing = False
        self.selected = 0
        self.follows = True
        """The selected task is the one that the message at the cursor is about, until another is chosen."""
        self._clock = 0.0
        self._wanted = ""
        self._asked = ""
        self._said = ""

    def compose(self) -> ComposeResult:
        """The panes."""
        yield TimeBar(self.recording, self._heading)
        with Vertical():
            with Horizontal(id="main"):
                yield TreePane()
                yield StoryPane(self.recording)
            yield MessagesPane(self.recording)
        yield Question(self._answer)
        yield Keys()

    def on_mount(self) -> None:
        """The screen is there."""
        self.query_one("#tree").border_title = "task tree"
        self.query_one("#story").border_title = "story"
        self.query_one("#messages").border_title = "messages"
        self.set_focus(self.query_one(TreePane))  # now: later it would take the focus from what is asked for meanwhile
        self.set_interval(1 / FRAMES, self._pass)
        self.call_after_refresh(lambda: self.go_to(self.place, self._said))  # what keys have said meanwhile stays

    def _heading(self) -> str:
        recording = self.recording
        how = f"{'playing' if self.is_playing else 'paused'}{'' if self.direction > 0 else ' backwards'}"
        where = f"{recording.time(self.place):.3f} s of {recording.time(recording.last):.3f} s"
        event = f"event {self.place + 1} of {recording.last + 1}"
        counts = f"{self.outline.living} tasks under way"
        said = f"   {self._said}" if self._said else ""
        return f"{self.title}   {where}   {event}   {counts}   {how}, speed {self.speed:g}{said}"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """While something is typed the keys are for that."""
        del parameters
        is_asking = isinstance(self.focused, Question)
        return not is_asking or action not in _OF_THE_TREE

    # --- moving ------------------------------------------------------------------------------------------------------

    def go_to(self, place: int, said: str = "") -> None:
        """Show the run as it was after an event."""
        self.place = min(max(place, 0), self.recording.last)
        self._said = said
        at = self.recording.at(self.place)
        if self.follows and (about := self._about()):
            self.selected = about
        if self.selected not in at.tasks:
            self.selected = int(at.top[0]) if at.top else 0
        rows = self.outline.rows(at, self.selected)
        self.query_one(TreePane).show(rows, at, self.selected)
        self.query_one(StoryPane).show(self.selected, at)
        self.query_one(MessagesPane).show(self.place)
        self.query_one(TimeBar).show(self.place)

    def _about(self) -> int:
        """The task that the event at the cursor is about: the one that failed, or whose question did; or the first that
        is named.
        """
        run = self.recording.run
        for fact in sorted(self.recording.facts(self.place), key=lambda fact: not isinstance(fact, Failed)):
            message = run.delivered(subject_of(fact)) if isinstance(fact, Failed) else None
            asker = message.by.message_id if message and message.by else 0
            for number in (subject_of(fact), asker, getattr(fact, "origin", 0)):
                if number in run.tasks:
                    return number
        return 0

    def _pass(self) -> None:
        """Let time pass."""
        if not self.is_playing:
            return
        self._clock += self.direction * self.speed / FRAMES
        place = self.recording.place_of(self._clock)
        is_over = place in (0, self.recording.last) and place == self.place
        if is_over and not self.recording.time(0) < self._clock < self.recording.time(self.recording.last):
            self.is_playing = False
            self.go_to(place)
        elif place != self.place:
            self.go_to(place)

    def action_step(self, step: int) -> None:
        """Go to the next message, or to the one before."""
        self.is_playing = False
        self.go_to(self.place + step)

    def action_play(self) -> None:
        """Let time pass, or hold it."""
        self.is_playing = not self.is_playing
        self._clock = self.recording.time(self.place)
        is_at_end = self.place == (self.recording.last if self.direction > 0 else 0)
        if self.is_playing and is_at_end:
            self.go_to(0 if self.direction > 0 else self.recording.last)
            self._clock = self.recording.time(self.place)
        self.go_to(self.place)

    def action_turn(self) -> None:
        """Let time pass the other way."""
        self.direction = -self.direction
        self._clock = self.recording.time(self.place)
        self.go_to(self.place)

    def action_speed(self, step: int) -> None:
        """Let time pass faster or slower."""
        higher = [speed for speed in SPEEDS if speed > self.speed]
        lower = [speed for speed in SPEEDS if speed < self.speed]
        self.speed = next(iter(higher if step > 0 else lower[::-1]), self.speed)
        self.go_to(self.place)

    def action_failure(self, step: int) -> None:
        """Go to the next failure, or to the one before."""
        self.is_playing = False
        found = self.recording.next_failure(self.place, step)
        if found is None:
            self.go_to(self.place, f"no failure {'follows' if step > 0 else 'before'}")
            return
        self.follows = True
        self.go_to(found)

    def action_go_to_start(self) -> None:
        """Go to the first event."""
        self.action_step(-self.place)

    def action_go_to_end(self) -> None:
        """Go to the last event."""
        self.action_step(self.recording.last)

    def on_time_bar_wanted(self, wanted: TimeBar.Wanted) -> None:
        """The bar of time was clicked."""
        self.is_playing = False
        self.go_to(wanted.place)

    # --- choosing ----------------------------------------------------------------------------------------------------

    def action_select(self, step: int) -> None:
        """Choose the task on the next line."""
        tree = self.query_one(TreePane)
        tasks = [row.task for row in tree.rows if row.task]
        if tasks:
            place = tasks.index(self.selected) + step if self.selected in tasks else 0
            self._select(tasks[min(max(place, 0), len(tasks) - 1)])

    def on_tree_pane_chosen(self, chosen: TreePane.Chosen) -> None:
        """A task was clicked."""
        self._select(chosen.task)

    def _select(self, task: int) -> None:
        self.selected, self.follows = task, False
        self.go_to(self.place)

    def action_scroll_story(self, pages: int) -> None:
        """Go back in the story of the selected task, or forward."""
        story = self.query_one(StoryPane)
        story.scroll_by(pages * max(story.size.height // 2, 1))

    def action_fold(self) -> None:
        """Open or close the selected task."""
        tree = self.query_one(TreePane)
        place = tree.place_of(self.selected)
        if place is not None:
            is_open = place + 1 < len(tree.rows) and tree.rows[place + 1].parent == self.selected
            self.outline.toggle(self.selected, is_open=is_open)
            self.follows = False
            self.go_to(self.place)

    # --- asking ------------------------------------------------------------------------------------------------------

    def action_ask_time(self) -> None:
        """Ask where to go."""
        self._ask("time", "go to: seconds, as in 12.5")

    def action_ask_name(self) -> None:
        """Ask what to look for."""
        self._ask("name", "search: part of a task's name, or its number")

    def _ask(self, what: str, words: str) -> None:
        self._asked = what
        self.is_playing = False
        ask = self.query_one(Question)
        ask.value, ask.placeholder = "", words
        ask.add_class("asked")
        self.set_focus(ask)  # at once: the next key may have been typed already

    def action_stop_asking(self) -> None:
        """Nothing is asked any more."""
        self.query_one(Question).remove_class("asked")
        self.set_focus(self.query_one(TreePane))

    def _answer(self, text: str) -> None:
        """What was asked for has been typed."""
        self.action_stop_asking()
        if self._asked == "name":
            self._wanted = text or self._wanted
            if self._wanted:
                self.action_search(1)
            return
        try:
            seconds = float(text.removesuffix("s"))
            end = self.recording.time(self.recording.last)
            beyond = f"the journal ends at {end:.3f} s" if seconds > end else ""
            self.go_to(self.recording.place_of(seconds), beyond)
        except ValueError:
            self.go_to(self.place, f"'{printable(text)}' is no time: write seconds, as in 12.5")

    def action_search(self, step: int) -> None:
        """Go to the birth of the next task that is looked for. One that is there already, and was asked for by its
        number, is chosen as it is now.
        """
        if not self._wanted:
            self.action_ask_name()
            return
        found = self.recording.search(self._wanted, self.place, step)
        if found is None:
            where = "later" if step > 0 else "before"
            self.go_to(self.place, f"no task '{printable(self._wanted)}' is sent {where}")
            return
        self.selected, self.follows = found, False
        born = self.recording.place_of_record(self.recording.run.tasks[found].received)
        is_asked_by_number = str(found) == self._wanted.strip("{}")
        self.go_to(self.place if is_asked_by_number and born < self.place else born)
