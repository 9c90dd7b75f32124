"""Actions, unfinished tasks and waiting scripts in words."""

from collections.abc import Callable
from functools import partial

from tca_tools.check.records import MessageRecord
from tca_tools.explore.play.actors import Actor, ModuleLine
from tca_tools.explore.play.identifiers import renamed
from tca_tools.explore.play.play import OPERATOR, Action, ActionKind, Play, Waiter
from tca_tools.explore.scenario import steps
from tca_tools.explore.scenario.requests import RequestWording
from tca_tools.explore.scenario.script_connection import CHOOSE
from tca_wire.packets import headers
from tca_wire.points import describe_moments


def describe(play: Play, action: Action) -> str:
    """Return an action in words: "gait planner in take steps {3} sends command move leg 2"."""
    return _DESCRIBE[action.kind](play, action)


def unfinished(play: Play) -> tuple[str, ...]:
    """Return the tasks and scripts that have not ended, each with what it waits for."""
    tasks = [_task_left(play, task) for task in play.world.tasks if not task.is_over]
    actors = [(line, actor) for line in play.lines.values() for actor in line.actors]
    return *tasks, *(_script_left(play, *one) for one in actors if one[1].step is not None)


def waiter_in_words(play: Play, waiter: Waiter) -> str:
    """Return a waiting task or script, with what it waits for."""
    if isinstance(waiter[0], int):
        return _task_left(play, play.world.items[waiter[0]])
    actor = waiter[0]
    line = next(line for line in play.lines.values() if actor in line.actors)
    return _script_left(play, line, actor)


def _script_left(play: Play, line: ModuleLine, actor: Actor) -> str:
    return f"{_actor_name(line, actor, play)} {_wait_in_words(play, actor, actor.step)}"


def _task_left(play: Play, task: MessageRecord) -> str:
    return f"{_name(play, task.id)} has not ended: {_task_status(play, task)}"


# --- actions --------------------------------------------------------------------------------------


def _step(play: Play, action: Action) -> str:
    line = play.lines[action.name]
    actor = line.actor
    assert actor is not None
    branch = actor.branches[action.index]
    decisions = [
        f"{'chooses' if got.kind == CHOOSE else 'finds itself'} {got.words}, "
        for got in branch.decisions
    ]
    step = _step_in_words(play, actor, branch.step)
    return f"{_actor_name(line, actor, play)} {''.join(decisions)}{step}"


def _receive(play: Play, action: Action) -> str:
    header, _ = play.inbox(action).in_transit[0]
    is_delivery = isinstance(header, headers.Deliver)
    numbers = [header.delivery] if is_delivery else getattr(header, "deliveries", [])
    names = ", ".join(_name(play, number) for number in numbers)
    return f"{action.name} receives {type(header).__name__} {names}".rstrip()


def _begin(play: Play, action: Action) -> str:
    header, _ = play.inbox(action).session.prefetched[0]
    return f"{action.name} starts {_name(play, header.delivery)}, which was prefetched"


def _join(play: Play, action: Action) -> str:
    run = play.runs[action.name]
    if not run.steps_joined:
        return f"{run.name} joins"
    if run.steps_joined == 1:
        return f"{run.name} registers its handlers"
    which = "a" if run.steps_joined == 2 else "one more"
    return f"{run.name} is ready for {which} message at a time"


def _break(play: Play, action: Action) -> str:
    line = play.lines[action.name]
    if line.run.is_alive:
        return f"{line.run.name} dies: connection {line.name} breaks"
    return f"connection {line.name} breaks, too"


def _time(play: Play, _: Action) -> str:
    assert play.next_time is not None
    return f"{round(play.next_time - play.now, 6):g} s pass"


def _timeout(play: Play, action: Action) -> str:
    line = play.lines[action.name]
    actor = line.stack[-1]
    name = _actor_name(line, actor, play)
    return f"{name} times out and no longer {_wait_in_words(play, actor, actor.step)}"


_DESCRIBE: dict[ActionKind, Callable[[Play, Action], str]] = {
    ActionKind.STEP: _step,
    ActionKind.RECEIVE: _receive,
    ActionKind.START: _begin,
    ActionKind.REPLY: lambda _, action: f"{action.name} sends the replies that it has held",
    ActionKind.JOIN: _join,
    ActionKind.BREAK: _break,
    ActionKind.LEAVE: lambda _, action: f"{action.name} starts to leave",
    ActionKind.GOODBYE: lambda _, action: f"{action.name} says goodbye",
    ActionKind.KILL: lambda play, action: (
        f"{OPERATOR} kills {_name(play, play.killable(action.name)[action.index].id)}"
    ),
    ActionKind.SUSPEND: lambda play, action: (
        f"{OPERATOR} suspends {_name(play, play.suspendable(action.name)[action.index].id)}"
    ),
    ActionKind.RESUME: lambda play, action: (
        f"{OPERATOR} resumes {_name(play, play.suspended[action.name][action.index])}"
    ),
    ActionKind.TIME: _time,
    ActionKind.TIMEOUT: _timeout,
}


# --- scripts --------------------------------------------------------------------------------------


def _actor_name(line: ModuleLine, actor: Actor, play: Play) -> str:
    name = line.run.name
    return f"{name} in {_name(play, actor.task or actor.delivery)}" if actor.delivery else name


def _step_in_words(play: Play, actor: Actor, step: steps.Step | None) -> str:
    if isinstance(step, steps.Ask):
        declared = {message.name: message.message_class for message in step.declares}
        header = renamed(step.header, actor.real_id)
        return _wording(play).request(
            header, step.body, declared.get(getattr(header, "message", ""))
        )
    if isinstance(step, steps.AwaitAnswer):
        return _wait_in_words(play, actor, step)
    if isinstance(step, steps.Abandon):
        return _abandon(actor, step)
    return _wording(play).filled(_STEPS[type(step)], step)


def _wait_in_words(play: Play, actor: Actor, step: steps.Step | None) -> str:
    """Return the wait of an actor in words."""
    if not isinstance(step, steps.AwaitAnswer):
        return _step_in_words(play, actor, step)
    header = actor.requests[step.request].header
    if isinstance(header, headers.AwaitPoint | headers.Lock | headers.WaitUntilHandled):
        return _wording(play).request(header, b"", None)
    message_class = play.central.registry.messages[header.message].message_class
    return f"waits for the answer to {message_class} {header.message}"


def _abandon(actor: Actor, step: steps.Abandon) -> str:
    request = actor.requests[step.request]
    is_held = isinstance(request.header, headers.Lock) and request.is_over
    return f"releases {request.header.resource}" if is_held else "abandons its request"


_STEPS: dict[type, str] = {
    steps.NoticeKill: "gets an error",
    steps.Return: "returns",
    steps.Fail: "[reissue?reissues its failure|fails: {failure}]",
    steps.ReadClientRequest: "[waits?waits for|checks for] a request of a client",
    steps.OweReply: "owes its reply",
    steps.UseKeptReplies: "uses the kept replies to {message}",
    steps.Hang: "waits forever",
}
"""By step without a request to central: its phrase."""


def _wording(play: Play) -> RequestWording:
    return RequestWording(partial(_name, play))


def _task_status(play: Play, task: MessageRecord) -> str:
    reached = ", ".join(describe_moments(task.reached)) or "nothing reached"
    awaited = [
        _wording(play).point(hold.constraint.before)
        for hold in task.holds
        if not (hold.is_met or hold.constraint.delay)
    ]
    parts = [
        reached,
        f"failed: {task.failure}" if task.failure else "",
        "being recovered" if task.recovering else "",
        "suspended" if task.is_suspended else "",
        "queued" if task.is_queued else "",
        f"handled by {task.module}" if task.module else "",
        f"waits for {', '.join(awaited)}" if awaited else "",
    ]
    return "; ".join(part for part in parts if part)


def _name(play: Play, task: int) -> str:
    return play.world.name(int(task))
