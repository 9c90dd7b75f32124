"""The replay on the terminal: what the keys do, and when time passes. Knows the recording and the
panes.
"""

import signal
import sys
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.widgets import Footer, HelpPanel

from tca_tools.replay.panes import MessagesPane, Question, StoryPane, TimeBar, TreePane
from tca_tools.replay.recording import Recording
from tca_tools.replay.tree import rows_at
from tca_tools.terminal import is_hung_up
from tca_wire.journal.facts import Failed
from tca_wire.text.measures import counted
from tca_wire.text.printable import printable

FRAMES = 15
"""How often the screen is drawn in a second while time passes."""
SPEEDS = (0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 100.0, 500.0, 1000.0, 5000.0)
_FAR = 20
_LEAST_BESIDE = 90
"""Columns: with fewer the story stands below the tree."""
_KEYS = (
    ("q", "leave", "quit"),
    ("space", "play", "play/pause"),
    ("right", "step(1)", "next message"),
    ("left", "step(-1)", "before"),
    ("plus,equals_sign", "speed(1)", "faster"),
    ("minus", "speed(-1)", "slower"),
    ("right_square_bracket,f", "failure(1)", "next failure"),
    ("slash", "ask('name')", "search"),
    ("enter", "fold", "open/close"),
    ("question_mark", "help", "all keys"),
)
_MORE_KEYS = (
    ("left_square_bracket,F", "failure(-1)", "the failure before"),
    ("n", "search(1)", "next that is found"),
    ("N", "search(-1)", "the one found before"),
    ("g", "ask('time')", "go to a time"),
    ("r", "turn", "time runs backwards"),
    ("up", "select(-1)", "the task above"),
    ("down", "select(1)", "the task below"),
    ("shift+right,ctrl+right", f"step({_FAR})", f"{_FAR} messages on"),
    ("shift+left,ctrl+left", f"step({-_FAR})", f"{_FAR} messages back"),
    ("pageup", "scroll_story(-1)", "back in the story"),
    ("pagedown", "scroll_story(1)", "on in the story"),
    ("home", f"step({-sys.maxsize})", "the first message"),
    ("end", f"step({sys.maxsize})", "the last message"),
)
"""The actions of keys, while nothing is typed: those that are named below the panes, and others,
which ``?`` names.
"""

_QUESTIONS = {
    "time": "go to: seconds, as in 12.5",
    "name": "search: part of a task's name or of a failure, or a task's number",
}


class Replay(App[None]):
    """A run, message by message."""

    CSS_PATH = "app.tcss"
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (_LEAST_BESIDE, "-wide")]  # noqa: RUF012 - the base class has it so
    BINDINGS: ClassVar = [
        *(Binding(key, action, words, priority=True) for key, action, words in _KEYS),
        *(
            Binding(key, action, words, show=False, priority=True)
            for key, action, words in _MORE_KEYS
        ),
        Binding("ctrl+c", "quit", "quit", show=False, priority=True),
        Binding("escape", "stop_asking", "type no more", show=False),
    ]
    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = ""
    """Nothing has the focus but what is being asked: other keys are for the replay."""

    def __init__(
        self, recording: Recording, name: str, *, speed: float = 1.0, at: float | None = None
    ) -> None:
        super().__init__()
        self.title = printable(name)
        self.recording = recording
        self.place = recording.last if at is None else recording.place_of(at)
        self.speed = speed
        self.direction = 1
        self.is_playing = False
        self.selected = 0
        self.follows = True
        """The selected task is the one that the message at the cursor is about, until another is
        chosen.
        """
        self._opened: dict[int, bool] = {}
        self._clock = 0.0
        self._wanted = ""
        self._asked = ""
        self._said = ""
        self._terminal = None
        if sys.__stdin__ and sys.__stdin__.isatty():
            self._terminal = sys.__stdin__.fileno()

    def compose(self) -> ComposeResult:
        """The panes."""
        panes = TreePane(self._select), StoryPane(self.recording), MessagesPane(self.recording)
        for pane, title in zip(panes, ("task tree", "story", "messages"), strict=True):
            pane.border_title = title
        yield TimeBar(self.recording, self._hold_at)
        with Vertical():
            with Horizontal(id="main"):
                yield from panes[:2]
            yield panes[2]
        yield Question(self._answer)
        yield Footer()

    def on_mount(self) -> None:
        """The screen is there."""
        self.query_one("#sentences").can_focus = False
        self.set_interval(1 / FRAMES, self._pass)

    def on_resize(self) -> None:
        """There is more room, or less."""
        # what keys have said meanwhile stays
        self.call_after_refresh(lambda: self.go_to(self.place, self._said))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool:
        """While something is typed the keys are for that."""
        del parameters
        is_typing = isinstance(self.focused, Question)
        return not is_typing or action in ("quit", "stop_asking")

    def action_leave(self) -> None:
        """End the replay."""
        self.exit()

    def go_to(self, place: int, said: str = "") -> None:
        """Show the run as it was after an event."""
        recording = self.recording
        self.place = min(max(place, 0), recording.last)
        self._said = said
        at = recording.at(self.place)
        if self.follows and (about := self._about()):
            self.selected = about
        if self.selected not in at.tasks:
            self.selected = int(at.top[0]) if at.top else 0
        rows = rows_at(at, self.selected, self._opened)
        self.query_one(TreePane).show(rows, at, self.selected)
        self.query_one(StoryPane).show(self.selected, at)
        self.query_one(MessagesPane).place = self.place
        heading = (
            self.title,
            f"{recording.time(self.place):.3f} s of {recording.time(recording.last):.3f} s",
            f"event {self.place + 1} of {recording.last + 1}",
            f"{counted(recording.under_way(at), 'task')} under way",
            f"{'playing' if self.is_playing else 'paused'}{' backwards' * (self.direction < 0)}, speed {self.speed:g}",
            said,
        )
        bar = self.query_one(TimeBar)
        bar.place, bar.said = self.place, "   ".join(heading)

    def _about(self) -> int:
        """The task that the event at the cursor is about: the one that failed, or whose question
        did; or the first that is named.
        """
        facts = self.recording.events[self.place] if self.recording.events else []
        failed_first = sorted(facts, key=lambda fact: not isinstance(fact, Failed))
        return next(filter(None, map(self.recording.about, failed_first)), 0)

    # --- moving -----------------------------------------------------------------------------------

    def _pass(self) -> None:
        """Let time pass. End if the terminal has gone: not everybody is told, and its input would
        be read for ever.
        """
        if self._terminal is not None and is_hung_up(self._terminal):
            signal.signal(signal.SIGHUP, signal.SIG_DFL)
            signal.raise_signal(signal.SIGHUP)
        if not self.is_playing:
            return
        self._clock += self.direction * self.speed / FRAMES
        place = self.recording.place_of(self._clock)
        start, end = self.recording.span
        self.is_playing = start < self._clock < end
        if place != self.place or not self.is_playing:
            self.go_to(place)

    def action_step(self, step: int) -> None:
        """Go to the next message, or to the one before."""
        self._hold_at(self.place + step)

    def _hold_at(self, place: int) -> None:
        self.is_playing = False
        self.go_to(place)

    def action_play(self) -> None:
        """Let time pass, or hold it; at the end, begin again."""
        self.is_playing = not self.is_playing
        beginning, end = (0, self.recording.last)[:: self.direction]
        self.go_to(beginning if self.is_playing and self.place == end else self.place)
        self._clock = self.recording.time(self.place)

    def action_turn(self) -> None:
        """Let time pass the other way."""
        self.direction = -self.direction
        self._clock = self.recording.time(self.place)
        self.go_to(self.place)

    def action_speed(self, step: int) -> None:
        """Let time pass faster or slower."""
        others = [speed for speed in SPEEDS[::step] if (speed - self.speed) * step > 0]
        self.speed = next(iter(others), self.speed)
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

    def action_help(self) -> None:
        """Show all keys, or show them no longer."""
        if self.screen.query(HelpPanel):
            self.action_hide_help_panel()
        else:
            self.action_show_help_panel()
        self.on_resize()

    # --- choosing ---------------------------------------------------------------------------------

    def action_select(self, step: int) -> None:
        """Choose the task on the next line."""
        rows = self.query_one(TreePane).rows
        tasks: list[int] = [row.task.id for row in rows if row.task]
        if tasks:
            place = tasks.index(self.selected) + step if self.selected in tasks else 0
            self._select(tasks[min(max(place, 0), len(tasks) - 1)])

    def _select(self, task: int) -> None:
        self.selected, self.follows = task, False
        self.go_to(self.place)

    def action_scroll_story(self, pages: int) -> None:
        """Go back in the story of the selected task, or forward."""
        self.query_one(StoryPane).scroll_pages(pages)

    def action_fold(self) -> None:
        """Open or close the selected task."""
        rows = self.query_one(TreePane).rows
        for row in rows:
            if row.task and row.task.id == self.selected:
                below = [one.task for one in rows if one.parent == row.number]
                self._opened[self.selected] = not any(below)
                self._select(self.selected)
                return

    # --- asking -----------------------------------------------------------------------------------

    def action_ask(self, what: str) -> None:
        """Ask where to go, or what to look for."""
        self._asked = what
        self.is_playing = False
        ask = self.query_one(Question)
        ask.value, ask.placeholder = "", _QUESTIONS[what]
        ask.add_class("asked")
        self.set_focus(ask)  # at once: the next key may have been typed already

    def action_stop_asking(self) -> None:
        """Nothing is asked any more."""
        self.query_one(Question).remove_class("asked")
        self.set_focus(None)

    def _answer(self, text: str) -> None:
        """Act on the answer to a question when it has been typed."""
        self.action_stop_asking()
        if self._asked == "name":
            self._wanted = text or self._wanted
            if self._wanted:
                self.action_search(1)
            return
        try:
            seconds = float(text.removesuffix("s"))
        except ValueError:
            said = f"'{printable(text)}' is no time: write seconds, as in 12.5"
            self.go_to(self.place, said)
            return
        _, end = self.recording.span
        said = f"the journal ends at {end:.3f} s" if seconds > end else ""
        self.go_to(self.recording.place_of(seconds), said)

    def action_search(self, step: int) -> None:
        """Go to the next task or failure that is looked for; behind the last one, to the first."""
        if not self._wanted:
            self.action_ask("name")
            return
        recording, said = self.recording, ""
        found = recording.search(self._wanted, self.place, step)
        if found is None:
            start = -1 if step > 0 else recording.last + 1
            found = recording.search(self._wanted, start, step)
            said = f"found from the {'start' if step > 0 else 'end'} again"
        if found is None:
            self.go_to(self.place, f"no task or failure '{printable(self._wanted)}'")
            return
        self.selected, self.follows = found.task, False
        self.go_to(found.place, said)
