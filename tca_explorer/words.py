"""Actions, and what is unfinished at the end, in words."""

from collections.abc import Callable
from typing import Any

import msgspec

from tca_explorer.actors import Actor, Line
from tca_explorer.play import Action, Kind, Play
from tca_explorer.script import CHOOSE
from tca_explorer.steps import AddConstraints, Fail, Hang, History, KillTask, Return, Say, Step, WaitUntil
from tca_explorer.world import Seen
from tca_wire.points import Point, describe_moments


def describe(play: Play, action: Action) -> str:
    """What is about to happen: "gait planner in take steps {3} sends command move leg 2"."""
    return _DESCRIBE[action.kind](play, action)


def unfinished(play: Play) -> tuple[str, ...]:
    """The tasks and scripts that have not ended, and what they wait for."""
    tasks = [f"{task} has not ended: {_standing(play, task)}" for task in play.world.tasks if not task.is_over]
    waiting = [(line, actor) for line in play.lines.values() for actor in line.stack if actor.step is not None]
    return (*tasks, *(f"{_who(line, actor, play)} {_waiting(play, actor)}" for line, actor in waiting))


# --- actions ---------------------------------------------------------------------------------------------------------


def _step(play: Play, action: Action) -> str:
    line = play.lines[action.name]
    actor = line.stack[-1]
    branch = actor.branches[action.index]
    return f"{_who(line, actor, play)} {_decisions(branch.decisions)}{_doing(play, actor, branch.step)}"


def _join(play: Play, action: Action) -> str:
    run = play.runs[action.name]
    if not run.steps_joined:
        return f"{run.name} joins"
    if run.steps_joined == 1:
        return f"{run.name} registers its handlers"
    return f"{run.name} is ready for {'a' if run.steps_joined == 2 else 'one more'} message at a time"


def _break(play: Play, action: Action) -> str:
    line = play.lines[action.name]
    return f"{line.run.name} dies: connection {line.name} breaks" if line.run.is_alive else f"{line.name} breaks, too"


def _kill(play: Play, action: Action) -> str:
    return f"somebody kills {play.killable(action.name)[action.index]}"


_DESCRIBE: dict[Kind, Callable[[Play, Action], str]] = {
    Kind.STEP: _step,
    Kind.JOIN: _join,
    Kind.BREAK: _break,
    Kind.LEAVE: lambda _, action: f"{action.name} begins to leave",
    Kind.BYE: lambda _, action: f"{action.name} says goodbye",
    Kind.KILL: _kill,
}


# --- scripts ---------------------------------------------------------------------------------------------------------


def _who(line: Line, actor: Actor, play: Play) -> str:
    return f"{line.run.name} in {_name(play, actor.delivery)}" if actor.delivery else line.run.name


def _decisions(decisions: History) -> str:
    words = [f"chooses {got.words}" if got.kind == CHOOSE else f"finds itself {'' if got.choice else 'not '}cancelled"
             for got in decisions]  # fmt: skip
    return "".join(f"{one}, " for one in words)


def _doing(play: Play, actor: Actor, step: Step | None) -> str:
    return _DO[type(step)](play, actor, step)


def _waiting(play: Play, actor: Actor) -> str:
    if isinstance(actor.step, Say):
        return f"waits for the answer to {actor.step.kind}"
    return _doing(play, actor, actor.step)


def _say(_play: Play, _actor: Actor, step: Say) -> str:
    data = msgspec.msgpack.decode(step.body)
    shown = "" if data is None else f" {msgspec.json.encode(data).decode()}"
    return f"sends {step.message.message_class} {step.message.name}{shown}"


def _add_constraints(play: Play, actor: Actor, step: AddConstraints) -> str:
    pairs = actor.real_constraints(step.constraints)
    return f"adds {'; '.join(f'{_point(play, c.before)} before {_point(play, c.after)}' for c in pairs)}"


_DO: dict[type, Callable[[Play, Actor, Any], str]] = {
    Say: _say,
    WaitUntil: lambda play, actor, step: f"waits for {_point(play, actor.real_point(step.point))}",
    KillTask: lambda play, actor, step: f"kills {_name(play, actor.real(step.task))}",
    AddConstraints: _add_constraints,
    Return: lambda _play, _actor, _step: "returns",
    Fail: lambda _play, _actor, step: f"fails: {step.failure}",
    Hang: lambda _play, _actor, _step: "never goes on",
}


def _standing(play: Play, task: Seen) -> str:
    reached = ", ".join(describe_moments(task.reached)) or "nothing reached"
    after = [_point(play, point) for _, point in task.after if not play.world.is_past(point)]
    parts = [
        reached,
        "queued" if task.is_queued else "",
        f"handled by {task.module}" if task.module else "",
        f"waits for {', '.join(after)}" if after else "",
    ]
    return "; ".join(part for part in parts if part)


def _point(play: Play, point: Point) -> str:
    return f"{describe_moments(point.moment)[0]} of {_name(play, point.task)}"


def _name(play: Play, task: int) -> str:
    return f"{play.names.get(task, '?')} {{{task}}}"
