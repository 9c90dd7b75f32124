"""What the tools tell of small runs: each in told/ is told event by event, and asked about in
between.

    # TITLE
    a line of a story: see tell()
    ? QUESTION                                and the answers, indented

A run may also be played by central: then each line is a command of its transcripts. See QUESTIONS
for what can be asked.
"""

import io
import re
from collections.abc import Callable, Iterator
from functools import partial
from itertools import groupby, pairwise
from operator import attrgetter
from typing import Any

import msgspec
from central.transcript import Transcript
from click import unstyle
from tools.runs import checked
from tools.story import Story, tell
from tools.trace_reader import Read, read_trace

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task, shares
from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits
from tca_tools.analysis.resources import uses
from tca_tools.analysis.step_words import why_not_sooner
from tca_tools.analysis.steps import Doing
from tca_tools.analysis.summary import span_of, summary
from tca_tools.explain.graph import causes
from tca_tools.explain.story import story
from tca_tools.explain.wait_words import in_the_end, last_of, reasons
from tca_tools.export.tables import TABLES, Table
from tca_tools.export.trace.packets import write_trace
from tca_tools.gantt.build import chart
from tca_tools.gantt.chart import Chart
from tca_tools.gantt.window import ALL, Pick
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import (
    describe_asker,
    fate,
    has_run_survived,
    retried_ancestor,
    run_continued,
    undecided_by,
)
from tca_tools.journal.fold import History
from tca_tools.journal.lives import life_at
from tca_tools.journal.selection import messages_of, waited_for
from tca_tools.journal.whole_run import Run
from tca_tools.log.classic import classic_lines
from tca_tools.report.contents import contents
from tca_tools.stats.measure import MessageStats, ResourceStats, Times, measure
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.outline import whole_outline
from tca_tools.tasktree_viz.text import story_lines, tree_lines
from tca_tools.tasktree_viz.words import data, note
from tca_wire.journal import facts
from tca_wire.points import TaskId


def told(text: str) -> str:
    """A run as in told/, with the answers to its questions."""
    tale, played, lines = Story(), Transcript(), list[str]()
    is_played = False
    for line in text.splitlines():
        if line.startswith("? "):
            entries = played.player.entries if is_played else tale.caused()
            lines += [line, *(f"  {one}".rstrip() for one in answers(entries, line[2:]) if one)]
        elif not line.startswith("  "):
            lines.append(line)
            if not line.startswith("#") and not tell(tale, line):
                is_played = True
                played.play(line)
    return "\n".join(lines)


# --- questions ------------------------------------------------------------------------------------


SECOND = 1_000_000_000


def answers(entries: list[facts.Entry], question: str) -> list[str]:
    """A question is a word, a task or message, a moment, one until which more is known, and when
    the journal ends:
    "fate 3 at 2.5 known 4 until 5".
    """
    found = re.fullmatch(
        r"(\w+)(?: (\d+))?(?: at ([\d.]+))?(?: known ([\d.]+))?(?: until ([\d.]+))?", question
    )
    assert found, question
    word, number, at, known, until = found.groups()
    about: dict[str, Any] = {"number": int(number)} if number is not None else {}
    if word in OF_ENTRIES:
        return OF_ENTRIES[word](entries) or ["-"]
    about |= {
        name: float(text) for name, text in (("at", at), ("known", known)) if text is not None
    }
    return QUESTIONS[word](History.until(entries, float(until) if until else None), **about) or [
        "-"
    ]


def at_moment(run: Run, at: float | None) -> RunAt:
    return RunAt(run) if at is None else RunAt.by_clock(run, at)


def story_of(run: Run, number: int, at: float | None = None) -> list[str]:
    """All that happened to a message; as it was told at a moment."""
    if at is not None:
        return [
            f"{one.time:g} {one.by(at, at)}" for one in story(run, number, at) if one.time <= at
        ]
    took = [
        " ..." if one.is_open else "" if one.seconds is None else f" ({one.seconds:.3g} s)"
        for one in story(run, number)
    ]
    return [
        f"{one.time:g}{lasts} {one.text}"
        for one, lasts in zip(story(run, number), took, strict=True)
    ]


def row(run: Run, number: int, at: float | None = None) -> list[str]:
    """What the tree says of a task: how it stands, and its note."""
    then = at_moment(run, at)
    task = then.tasks[TaskId(number)]
    return [", ".join(filter(None, (task.standing, data(task), note(then, task))))]


def states(run: Run, number: int) -> list[str]:
    """The states of a task."""
    return [f"{time:g} {state}" for time, state in run.tasks[TaskId(number)].states]


def end(run: Run, number: int, at: float | None = None) -> list[str]:
    """What a task waits for in the end."""
    then = at_moment(run, at)
    return [str(in_the_end(then, then.tasks[TaskId(number)]) or "-")]


def all_causes(run: Run, at: float | None = None) -> list[str]:
    """What all tasks wait for in the end."""
    then = at_moment(run, at)
    waiting, things, found = causes(then)
    told = [f"{last_of(then, one.ends[0])}: {one.tasks}, first {one.first}" for one in found]
    return [f"{waiting} wait for {things}", *told]


def chain(run: Run, number: int, at: float | None = None) -> list[str]:
    """A failure, step by step."""
    links = failure_chain(run, TaskId(number), run.time if at is None else at)
    return [f"{one.time:g} {'  ' * one.depth}{one.text}" for one in links]


def all_failures(run: Run) -> list[str]:
    """The failures of a run, and what became of them."""
    told = []
    for kind in failures(run):
        told.append(
            f"{kind.failure} of {kind.message}{' (overcome)' * kind.is_good}, cost {kind.cost:.3g} s"
        )
        for one in kind.cases:
            why = f" ({one.why})" if one.why else ""
            told.append(
                f"  {one.time:g} {one.of}: {one.text!r} raised {one.raised_by or '-'}: {one.fate.name}{why}"
            )
            told += [f"    {text}" for text in one.called]
            told.append(f"    {one.lost:.3g} s lost, {one.recovery:.3g} s of recovery")
    return [*told, "so the run is " + ("good" if summary(run).is_good else "bad")]


def fate_of(run: Run, number: int, at: float, known: float = float("inf")) -> list[str]:
    """What became of a failure at a moment."""
    failed = run.messages[number]
    told = [
        fate(run, failed, at, known).name,
        "goes on" if run_continued(run, failed, at, known) else "ends",
        describe_asker(run, failed, at, known),
    ]
    if task := run.tasks.get(TaskId(number)):
        again = retried_ancestor(run, task, at, known)
        told.append(f"begun again with {again}" if again else "")
    told.append(f"depends on {len(undecided_by(run, failed, at))}")
    return ["; ".join(filter(None, told))]


def coped(run: Run, number: int, at: float) -> list[str]:
    return [str(has_run_survived(run, run.messages[number], at))]


def path(run: Run, number: int = 0) -> list[str]:
    """The critical path of a task (by default of the last one), and why no step began sooner."""
    task = run.tasks[TaskId(number)] if number else last_task(run)
    if task is None:
        return []
    found = critical_path(run, Causes(run), task)
    told = []
    for step in found.steps:
        what = run.name(step.message_id) if step.doing is Doing.WORK else str(step.doing)
        why = why_not_sooner(run, step)
        told.append(
            f"{step.start:g} to {step.end:g}: {what}{f' in {step.module}' if step.module else ''}{f': {why}' if why else ''}"
        )
    told += [f"because {one}" for one in found.because]
    return [*told, "..."] if found.is_open else told


def where_time_went(run: Run, number: int = 0) -> list[str]:
    task = run.tasks[TaskId(number)] if number else last_task(run)
    assert task
    found = shares(run, critical_path(run, Causes(run), task))
    return [f"{one.name} in {one.where or '-'}: {one.steps}, {one.seconds:.3g} s" for one in found]


def waits(run: Run) -> list[str]:
    """The longest waits of each kind."""
    told = []
    for kind in long_waits(run):
        told.append(f"{kind.kind}: {kind.number}, {kind.seconds:.3g} s")
        told += [
            f"  {one.who} {one.what} ({one.seconds:.3g} s{', goes on' * one.is_open})"
            for one in kind.longest
        ]
    return told


def all_reasons(run: Run, number: int, at: float | None = None) -> list[str]:
    then = at_moment(run, at)
    return reasons(then, then.tasks[TaskId(number)])


def advice(run: Run) -> list[str]:
    told = []
    for one in contents(run).advice:
        told.append(
            f"{one.topic}: {one.title}; saves {one.saving:.3g} s, {one.on_path:.3g} s on the path, {one.times} times"
        )
        told += [f"  {text}" for text in (one.text, one.remedy, one.example, one.sooner) if text]
    return told


def bars(run: Run, number: int | None = None, at: float | None = None) -> list[str]:
    """The chart, with what holds one message; from a moment on."""
    return list(all_of_a_chart(chart(run, at, pick=ALL if number is None else Pick(held={number}))))


def all_of_a_chart(drawing: Chart) -> Iterator[str]:
    yield f"{drawing.start:.2f} to {drawing.end:.2f}: {', '.join(drawing.names)}"
    for row in drawing.rows:
        yield f"{row.label}, connected {row.connected}"
        for bar in (*row.bars, *row.claims):
            end = "open" if bar.is_open else bar.ending
            yield f"  {bar.kind} {bar.lane} {bar.name} {bar.start} {bar.end} {end}: {bar.title()}".replace(
                " : ", ": "
            )
            yield from (f"    {mark.time} {mark.ending}: {mark.title}" for mark in bar.marks)
            yield from (f"    {wait.start} {wait.end}: {wait.title()}" for wait in bar.waits)
            yield from [f"    {bar.reason(200)}"] * (bar.why is not None)


def trace_of(run: Run) -> Read:
    """The Perfetto trace of a run, read back."""
    stream = io.BytesIO()
    write_trace(run, stream)
    return read_trace(stream.getvalue())


def all_of_a_trace(read: Read) -> Iterator[str]:
    """Its tracks with their slices, arrows, counters."""
    for track, slices in groupby(
        sorted(read.slices, key=attrgetter("track", "lane", "start")), key=attrgetter("track")
    ):
        yield track
        for one in slices:
            until = (
                ""
                if one.end == one.start
                else " on"
                if one.end is None
                else f" to {one.end / SECOND:.3f}"
            )
            details = ", ".join(f"{key}: {value}" for key, value in one.details.items())
            yield f"{'  ' * (one.depth + 1)}{one.start / SECOND:.3f}{until} {one.category}: {one.name}; {details}"
    for number, stations in sorted(read.flows.items()):
        yield f"arrow {number}: {' -> '.join(f'{one.name} ({one.track})' for one in stations)}"
    for counter, values in read.counters.items():
        yield f"{counter}: {', '.join(f'{number} at {time / SECOND}' for time, number in values)}"


def tree(run: Run, at: float | None = None) -> list[str]:
    then = at_moment(run, at)
    return [unstyle(line) for line in tree_lines(then, whole_outline(then), width=None)]


def shown(run: Run, number: int) -> list[str]:
    """A story as it is printed."""
    return [
        line
        for text in story_lines(run, TaskId(number), 200)
        for line in unstyle(text).splitlines()
    ]


def in_short(run: Run) -> list[str]:
    """The outcome of a run."""
    found, named = summary(run), {"last": last_task(run), "longest": longest_task(run)}
    is_good = "good" if found.is_good else "not good"
    return [
        f"{found.outcome} ({is_good}; {found.failures} failures, {found.modules} modules, {found.start:g} to {found.end:g})",
        ", ".join(f"{number} {state}" for state, number in found.tasks.items()),
        ", ".join(f"{title} {task}" for title, task in named.items()),
        *(f"dropped: {number} of {message}" for message, number in found.dropped),
    ]


def runs(run: Run) -> list[str]:
    """When handlers ran, and what waited and was locked when."""
    told = []
    for one in run.handlings:
        whose = f", directly from {one.direct_from}" if one.direct_from else ""
        told.append(
            f"{one.name} in {one.module}{whose}: {one.start:.6g} to {one.end and f'{one.end:.6g}'} {one.outcome}"
        )
        told += [
            f"  waits for {wait.awaited} from {wait.start:.6g} to {wait.end}" for wait in one.waits
        ]
    told += [
        f"{one.message_id} queued for {one.module}: {one.start:.6g} to {one.end and f'{one.end:.6g}'}"
        for one in run.queueings
    ]
    return told + [
        f"claim of {one.resource}: {one.start:g}, {one.granted}, {one.end} {one.ended}"
        for one in run.claims.values()
    ]


def all_uses(run: Run) -> list[str]:
    """How busy resources were."""
    return [
        f"{one.name} of {one.key[0]}: {one.handled} handled, {one.busy:.3g} s busy ({one.share:.0%} of {one.capacity}), locked"
        f" {one.locked:.3g} s; {one.queued} queued for {one.queue_seconds:.3g} s, at most {one.longest_queue}, now {one.waiting}"
        for one in uses(run, *span_of(run))
    ]


def life(run: Run, number: int, at: float | None = None) -> list[str]:
    """The states of a task, each from when on; what is known of it at a moment."""
    task = run.tasks[TaskId(number)]
    if at is None:
        lives = [(time, life_at(run, task, time)) for time in run.times]
        states = [
            (time, f"{life.state}, {life.serial}") for time, life in lives if time >= task.received
        ]
        return [
            f"{time:g} {new}"
            for (_, old), (time, new) in pairwise([(0.0, ""), *states])
            if new != old
        ]
    then = life_at(run, task, at)
    told = {
        "progress": then.progress,
        "asked": then.asked,
        "data": RunAt(run, at).tasks[TaskId(number)].body,
    }
    known = [f"{name} {msgspec.msgpack.decode(text)}" for name, text in told.items() if text]
    return [", ".join([f"{then.state}, {then.serial}", *known])]


def messages(run: Run, number: int) -> list[str]:
    """All that belong to a task."""
    return [f"{run.name(one)} {{{one}}}" for one in sorted(messages_of(run, [TaskId(number)]))]


def waited(run: Run, number: int) -> list[str]:
    """All that a message waited for."""
    return [str(int(one)) for one in sorted(waited_for(run, TaskId(number), {TaskId(number)}))]


def figures(run: Run, at: float | None = None) -> list[str]:
    """Counts and times, of the part that begins at a moment."""
    found = measure(run, start=at)
    told = [f"{found.deadlocks} deadlocks"]
    every: list[MessageStats | ResourceStats] = [*found.messages, *found.resources]
    for one in every:
        known = {name: getattr(one, name) for name in one.__slots__ if getattr(one, name)}
        counts = [f"{value} {name}" for name, value in known.items() if isinstance(value, int)]
        times = [
            f"{name} {', '.join(f'{second:.3g}' for second in value.seconds)}{f' ({len(value.open_times)} go on)' * bool(value.open_times)}"
            for name, value in known.items()
            if isinstance(value, Times) and value.seconds
        ]
        use = (
            [f"busy {one.use.busy:.3g}, waiting {one.use.waiting:.3g}"]
            if isinstance(one, ResourceStats) and one.use
            else []
        )
        named = (
            one.message
            if isinstance(one, MessageStats)
            else f"resource {one.resource or 'of nobody'}"
        )
        told.append("; ".join([f"{named}: {', '.join(counts)}", *times, *use]))
    return told


def rows(table: Table, run: Run) -> list[str]:
    """The rows of an exported table, without empty cells."""
    return [
        ", ".join(
            f"{name} {cell}"
            for name, cell in zip(table.columns, row, strict=True)
            if cell is not None
        )
        for row in table.rows(run)
    ]


def check(entries: list[facts.Entry]) -> list[str]:
    return [f"{one.rule}: {one.what}" for one in checked(entries)]


OF_ENTRIES: dict[str, Callable[[list[facts.Entry]], list[str]]] = {
    "check": check,
    "classic": lambda entries: list(classic_lines(entries)),
}
QUESTIONS: dict[str, Callable[..., list[str]]] = {
    "story": story_of, "row": row, "states": states, "end": end, "causes": all_causes, "chain": chain, "failures": all_failures,
    "fate": fate_of, "coped": coped, "path": path, "shares": where_time_went, "waits": waits, "reasons": all_reasons,
    "advice": advice, "bars": bars, "tree": tree, "shown": shown, "trace": lambda run: list(all_of_a_trace(trace_of(run))), "summary": in_short, "runs": runs, "uses": all_uses, "life": life,
    "messages": messages, "waited": waited, "figures": figures,
    **{f"table_{table.name}": partial(rows, table) for table in TABLES},
}  # fmt: skip
