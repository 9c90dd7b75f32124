"""What to do about the waits on a critical path, and by how much sooner its end could come at most. Pure."""

from collections import defaultdict
from collections.abc import Iterator

from tca_tools.analysis.advised import Advice, Sum, Topic, Words, length
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import CriticalPath
from tca_tools.analysis.given_up import still_handled_in_words
from tca_tools.analysis.held_up import HeldUp, Reason, held_up
from tca_tools.analysis.long_waits import handler_wait_in_words
from tca_tools.analysis.resources import Use
from tca_tools.analysis.steps import Doing
from tca_tools.run.whole_run import Run
from tca_tools.spans import Span
from tca_wire.text.measures import duration, percent, run_time, times


def on_waits(
    run: Run, causes: Causes, path: CriticalPath, window: Span, uses: list[Use], at_least: float, called: str
) -> Iterator[Advice]:
    """Advice for each kind of wait that lies on a path within a window; *called* is what to call the path."""
    by_name = {use.name: use for use in uses}
    for held in held_up(run, causes, path, window, at_least):
        use = by_name.get(held.name) if held.reason is Reason.QUEUE else None
        yield _on_wait(run, held, use, window, called)
    delays: dict[str, Sum] = defaultdict(Sum)
    for step in path.steps:
        if step.doing is Doing.DELAY:
            delays[run.name(step.message_id)].add(step.start, step.end, run.describe(step.message_id))
    for name, total in delays.items():
        saving = total.within(*window)
        often = times(total.times)
        title, text, remedy = _filled(_DELAY, name=name, times=often, seconds=duration(saving), path=called)
        yield Advice(
            Topic.DELAY, title, text, saving, saving, total.times, total.words, remedy, total.longest
        )  # fmt: skip


def bottleneck(name: str) -> str:
    """The title of what is said of a resource that is waited for."""
    return _WORDS[Reason.QUEUE].title.format(name=name)


def _on_wait(run: Run, held: HeldUp, use: Use | None, window: Span, called: str) -> Advice:
    saving, busy, but = held.saving, "", ""
    if use:
        busy = f" It is busy {percent(use.share)} of the time, with {use.capacity} at a time."
        least = use.worked / (use.capacity + 1)
        rest = max(length(use.window) - least, 0.0)
        if window[1] >= use.window[1] and saving > rest:
            saving, but = rest, f": what it has to do would still take {duration(least)}"
    most = "that" if duration(saving) == duration(held.seconds) else duration(saving)
    title, text, remedy = _filled(
        _WORDS[held.reason], name=held.name, times=times(held.times), seconds=duration(held.seconds),
        busy=busy, most=most, but=but, path=called,
    )  # fmt: skip
    example, longest = _longest(run, held), (held.longest.start, held.longest.end)
    return Advice(_TOPICS[held.reason], title, text, saving, saving, held.times, example, remedy, longest)


def _filled(words: Words, **known: str) -> Words:
    return Words(*(one.format(**known) for one in words))


def _longest(run: Run, held: HeldUp) -> str:
    """The longest of some waits, in words, with what is known of why."""
    step, longest = held.step, held.longest
    asked = step.message_id
    if longest.queueing is None and step.resumed:
        what = f"the handler of {run.describe(asked)} waited {handler_wait_in_words(run, step.resumed)},"
        asked = step.resumed.awaited
    else:
        what = f"{run.describe(asked)} waited"
    words = f"{what} {duration(longest.seconds)}, until {run_time(longest.end)}"
    if longest.claim:
        words += f"; {longest.claim.sender} had {'it' if longest.claim.granted is not None else 'asked for it'}"
    return words + still_handled_in_words(run, asked, longest.end)


_TOPICS = {
    Reason.QUEUE: Topic.CAPACITY,
    Reason.LOCK: Topic.LOCK,
    Reason.CLAIM: Topic.LOCK,
    Reason.REPLY: Topic.QUERY,
    Reason.IN_VAIN: Topic.IN_VAIN,
}
_WORDS = {
    Reason.REPLY: Words(
        "The reply to '{name}' is waited for",
        "The {path} waits {times} for the reply to '{name}', {seconds} in all. A reply that is there when it is needed "
        "would save at most {most}",
        "ask before something slow and fetch the reply later (query_send), keep the value as a variable, or answer "
        "faster",
    ),
    Reason.IN_VAIN: Words(
        "The reply to '{name}' is waited for in vain",
        "The {path} waits {times} for a reply to '{name}' that does not come in time, {seconds} in all. Without that "
        "wait it would be shorter by at most {most}",
        "find out why it takes so long, answer faster, or give up sooner (timeout=). Giving up does not end the "
        "handler: it keeps its resource from all others until it returns",
    ),
    Reason.QUEUE: Words(
        "{name} is a bottleneck",
        "The {path} stands {times} in the queue for {name}, {seconds} in all.{busy} One more slot, or a second module "
        "in its pool, would save at most {most}{but}",
        "raise its capacity, share its messages in a pool, or split what it handles over two resources",
    ),
    Reason.LOCK: Words(
        "{name} is locked while others wait",
        "The {path} waits {times} because {name} is locked or reserved, or somebody waits to lock it, {seconds} in "
        "all. Locks held only while they are needed would save at most {most}",
        "take the lock later, release it sooner, or lock a smaller resource",
    ),
    Reason.CLAIM: Words(
        "{name} is busy when it is to be locked",
        "The {path} waits {times} to lock or reserve {name} until what is handled there is done, {seconds} in all; "
        "more capacity does not help, for who locks it waits for all that is handled there. Had it been free, that "
        "would save at most {most}",
        "lock it when nothing is handled there, send it less before, or lock a smaller resource",
    ),
}
_DELAY = Words(
    "Delays before '{name}'",
    "Constraints with a delay hold '{name}' back {times} on the {path}, {seconds} in all. Shorter ones would save at "
    "most that",
    "shorten the delay, if what it waits for allows that",
)
