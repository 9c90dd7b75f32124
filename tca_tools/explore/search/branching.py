"""The causes of many states in a scenario: actions that may happen beside others, by their
source.
"""

from collections import Counter
from collections.abc import Iterable

from tca_tools.explore.play.play import Action, ActionKind, Play

_MOST_NAMED = 4

_TIMES = {
    "release": "delays",
    "deadline": "the deadline of {}",
    "kill": "a later kill of {}",
    "test": "the period of monitor {}",
    "watched": "the duration of monitor {}",
    "claim": "the timeout of a lock",
    "hung": "the look for a handler that hangs",
}
"""By what a timer is for: what is due."""

_SOURCES = {
    ActionKind.JOIN: "{} joining",
    ActionKind.BREAK: "the loss of {}",
    ActionKind.LEAVE: "{} leaving",
    ActionKind.GOODBYE: "{} leaving",
    ActionKind.TIMEOUT: "timeouts of {}",
    ActionKind.KILL: "kills of {}",
    ActionKind.SUSPEND: "suspensions of {}",
    ActionKind.RESUME: "suspensions of {}",
    ActionKind.TIME: "{}",
}
"""By kind of action; all others are steps of a module."""


class Branching:
    """Counts, over the states that were gone on from, in how many each thing could happen beside
    others.
    """

    def __init__(self) -> None:
        self._states = 0
        self._open: Counter[str] = Counter()

    def add(self, play: Play, actions: Iterable[Action]) -> None:
        """A state, and what may happen in it."""
        self._states += 1
        sources = {_source(play, action) for action in actions}
        if len(sources) > 1:
            self._open.update(sources)

    def most(self) -> tuple[str, ...]:
        """The sources open most often, with their part of the states: "steps of arm (61 %)"."""
        most = sorted(self._open.items(), key=lambda one: (-one[1], one[0]))[:_MOST_NAMED]
        return tuple(f"{source} ({100 * number / self._states:.0f} %)" for source, number in most)


def _source(play: Play, action: Action) -> str:
    name = _due(play) if action.kind is ActionKind.TIME else action.name
    if name in play.lines:
        name = play.lines[name].run.module.name
    elif name in play.runs:
        name = play.runs[name].module.name
    return _SOURCES.get(action.kind, "steps of {}").format(name)


def _due(play: Play) -> str:
    """The event to which time passes."""
    timer = min(play.central.clock.pending(), key=lambda timer: timer.time, default=None)
    if timer is None or timer.time != play.next_time:
        return "timeouts of scripts"
    task = getattr(timer.subject, "task", None)
    return _TIMES.get(timer.due, "time").format(
        f"'{task.message.name}'" if task is not None else "tasks"
    )
