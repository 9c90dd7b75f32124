"""Whether the run went on after a failure: its task was handled again or dealt with, or who had asked coped with it.

Of a query that fails the sender is told; what he makes of it, the facts show: his handler ends well, or fails too, and
then it depends on what became of that. A program outside of any handler is told, and nothing fails with it.
"""

from bisect import bisect_right
from operator import itemgetter

from tca_tools.past import Past
from tca_tools.records import Handling, Message, State, Task
from tca_wire.vocabulary import Outcome, Role

_SINCE = itemgetter(0)


def went_on(past: Past, message: Message, time: float) -> bool:
    """Whether the run went on, or still may, after what failed at *time*."""
    while not isinstance(message, Task):
        if message.role is Role.CONDITION and (monitor := past.tasks.get(message.about)):
            message = monitor
            continue
        if not message.message_class.has_reply:
            return False  # nobody is told
        run = message.by
        if run is None or run.outcome is not Outcome.FAILED:
            return True
        asker = past.messages.get(run.message_id)
        if asker is None:
            return False
        message, time = asker, run.end or time  # older than what it asked, so this ends
    return _is_handled(message, time)


def has_coped(past: Past, handling: Handling) -> bool:
    """The same of the run of a handler that failed."""
    message = past.messages.get(handling.message_id)
    if message is not None:
        return handling.end is not None and went_on(past, message, handling.end)
    known = past.formats.get(handling.name)  # it came directly, or is one of many copies
    return known is not None and known.message_class.has_reply


def told_to(past: Past, message: Message, time: float) -> str:
    """Who is told of the failure of a query, and what came of it: "told to chef, who went on"."""
    if not message.message_class.has_reply:
        return ""
    if message.role is Role.CONDITION:
        return f"told to central, for {past.describe(message.about)}"
    if message.by is None:
        return f"told to {message.sender}"
    asker = past.describe(message.by.message_id)
    if message.by.end is None:
        return f"told to {message.sender}, whose handler of {asker} still runs"
    if message.by.outcome is not Outcome.FAILED:
        return f"told to {message.sender}, whose handler of {asker} went on"
    after = ", and that was handled" if went_on(past, message, time) else ""
    return f"told to {message.sender}, whose handler of {asker} failed then{after}"


def _is_handled(task: Task, time: float) -> bool:
    """Not if a task ended with its failure."""
    if not task.failure and not any(name == "failure" for _, name, _ in task.changes):
        return False
    place = max(bisect_right(task.states, time, key=_SINCE) - 1, 0)
    after = (state for _, state in task.states[place:] if state is not State.RECOVERING)
    return next(after, State.RECOVERING) not in (State.FAILED, State.KILLED)
