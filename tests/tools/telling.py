"""The language of told/: small runs, event by event, with questions in between.

    # TITLE
    a line of a story: see apply_line()
    ? QUESTION                                and the answers, indented

Central can play a run, too: each line is then a command of its transcripts. QUESTIONS lists the
questions.
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
from tools.story import Story, apply_line
from tools.trace_reader import Read, Slice, read_trace

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task, shares
from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits
from tca_tools.analysis.resources import uses
from tca_tools.analysis.step_words import why_not_sooner
from tca_tools.analysis.steps import Doing
from tca_tools.analysis.summary import span_of, summary
from tca_tools.explain.graph import causes
from tca_tools.explain.story import Sentence, story
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
    still_deciding,
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


def answered(text: str) -> str:
    """Return a run of told/ with current answers to its questions."""
    handmade, played, lines = Story(), Transcript(), list[str]()
    is_played = False
    for line in text.splitlines():
        if line.startswith("? "):
            entries = played.player.entries if is_played else handmade.caused()
            lines += [line, *(f"  {one}".rstrip() for one in answers(entries, line[2:]) if one)]
        elif not line.startswith("  "):
            lines.append(line)
            if not line.startswith("#") and not apply_line(handmade, line):
                is_played = True
                played.play(line)
    return "\n".join(lines)


# --- questions ------------------------------------------------------------------------------------


SECOND = 1_000_000_000


def answers(entries: list[facts.Entry], question: str) -> list[str]:
    """Return the answers to a question, such as "fate 3 at 2.5 known 4 until 5".

    Its parts are a word, a message, an instant, the instant of knowledge, and the journal's end.
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


def at_instant(run: Run, at: float | None) -> RunAt:
    return RunAt(run) if at is None else RunAt.by_clock(run, at)


def story_of(run: Run, number: int, at: float | None = None) -> list[str]:
    """Return the story of a message, as it was shown at an instant."""
    if at is not None:
        return [
            f"{one.time:g} {one.text_at(at, at)}"
            for one in story(run, number, at)
            if one.time <= at
        ]
    return [f"{one.time:g}{_duration(one)} {one.text}" for one in story(run, number)]


def _duration(sentence: Sentence) -> str:
    if sentence.is_open:
        return " ..."
    return "" if sentence.seconds is None else f" ({sentence.seconds:.3g} s)"


def row(run: Run, number: int, at: float | None = None) -> list[str]:
    """Return the row of a task in the tree: its standing, data and note."""
    then = at_instant(run, at)
    task = then.tasks[TaskId(number)]
    return [", ".join(filter(None, (task.standing, data(task), note(then, task))))]


def states(run: Run, number: int) -> list[str]:
    """Return the states of a task."""
    return [f"{time:g} {state}" for time, state in run.tasks[TaskId(number)].states]


def final_wait(run: Run, number: int, at: float | None = None) -> list[str]:
    """Return the last wait in the chain of waits of a task."""
    then = at_instant(run, at)
    return [str(in_the_end(then, then.tasks[TaskId(number)]) or "-")]


def all_causes(run: Run, at: float | None = None) -> list[str]:
    """Return the common causes of all waits."""
    then = at_instant(run, at)
    waiting, things, found = causes(then)
    lines = [f"{last_of(then, one.ends[0])}: {one.tasks}, first {one.first}" for one in found]
    return [f"{waiting} wait for {things}", *lines]


def chain(run: Run, number: int, at: float | None = None) -> list[str]:
    """Return the steps of a failure."""
    links = failure_chain(run, TaskId(number), run.time if at is None else at)
    return [f"{one.time:g} {'  ' * one.depth}{one.text}" for one in links]


def all_failures(run: Run) -> list[str]:
    """Return the failures of a run with their fates."""
    lines = []
    for kind in failures(run):
        lines.append(
            f"{kind.failure} of {kind.message}{' (overcome)' * kind.is_good}, cost {kind.cost:.3g} s"
        )
        for one in kind.cases:
            why = f" ({one.why})" if one.why else ""
            lines.append(
                f"  {one.time:g} {one.of}: {one.text!r} raised {one.raised_by or '-'}: {one.fate.name}{why}"
            )
            lines += [f"    {text}" for text in one.called]
            lines.append(f"    {one.lost:.3g} s lost, {one.recovery:.3g} s of recovery")
    return [*lines, "so the run is " + ("good" if summary(run).is_good else "bad")]


def fate_of(run: Run, number: int, at: float, known: float = float("inf")) -> list[str]:
    """Return the fate of a failure at an instant."""
    failed = run.messages[number]
    parts = [
        fate(run, failed, at, known).name,
        "goes on" if run_continued(run, failed, at, known) else "ends",
        describe_asker(run, failed, at, known),
    ]
    if task := run.tasks.get(TaskId(number)):
        again = retried_ancestor(run, task, at, known)
        parts.append(f"begun again with {again}" if again else "")
    parts.append(f"depends on {len(still_deciding(run, failed, at))}")
    return ["; ".join(filter(None, parts))]


def continued(run: Run, number: int, at: float) -> list[str]:
    return [str(has_run_survived(run, run.messages[number], at))]


def path(run: Run, number: int = 0) -> list[str]:
    """Return the critical path of a task (default: the last task), and why no step began sooner."""
    task = run.tasks[TaskId(number)] if number else last_task(run)
    if task is None:
        return []
    found = critical_path(run, Causes(run), task)
    lines = []
    for step in found.steps:
        what = run.name(step.message_id) if step.doing is Doing.WORK else str(step.doing)
        why = why_not_sooner(run, step)
        lines.append(
            f"{step.start:g} to {step.end:g}: {what}{f' in {step.module}' if step.module else ''}{f': {why}' if why else ''}"
        )
    lines += [f"because {one}" for one in found.because]
    return [*lines, "..."] if found.is_open else lines


def path_shares(run: Run, number: int = 0) -> list[str]:
    task = run.tasks[TaskId(number)] if number else last_task(run)
    assert task
    found = shares(run, critical_path(run, Causes(run), task))
    return [f"{one.name} in {one.where or '-'}: {one.steps}, {one.seconds:.3g} s" for one in found]


def waits(run: Run) -> list[str]:
    """Return the longest waits of each kind."""
    lines = []
    for kind in long_waits(run):
        lines.append(f"{kind.kind}: {kind.number}, {kind.seconds:.3g} s")
        lines += [
            f"  {one.who} {one.what} ({one.seconds:.3g} s{', goes on' * one.is_open})"
            for one in kind.longest
        ]
    return lines


def all_reasons(run: Run, number: int, at: float | None = None) -> list[str]:
    then = at_instant(run, at)
    return reasons(then, then.tasks[TaskId(number)])


def advice(run: Run) -> list[str]:
    lines = []
    for one in contents(run).advice:
        lines.append(
            f"{one.topic}: {one.title}; saves {one.saving:.3g} s, {one.on_path:.3g} s on the path, {one.times} times"
        )
        lines += [f"  {text}" for text in (one.text, one.remedy, one.example, one.sooner) if text]
    return lines


def bars(run: Run, number: int | None = None, at: float | None = None) -> list[str]:
    """Return the chart from an instant on, with the constraints that hold one message."""
    return list(bar_lines(chart(run, at, pick=ALL if number is None else Pick(held={number}))))


def bar_lines(drawing: Chart) -> Iterator[str]:
    yield f"{drawing.start:.2f} to {drawing.end:.2f}: {', '.join(drawing.names)}"
    for row in drawing.rows:
        yield f"{row.label}, connected {row.connected}"
        for bar in (*row.bars, *row.claims):
            ending = "open" if bar.is_open else bar.ending
            yield f"  {bar.kind} {bar.lane} {bar.name} {bar.start} {bar.end} {ending}: {bar.title()}".replace(
                " : ", ": "
            )
            yield from (f"    {mark.time} {mark.ending}: {mark.title}" for mark in bar.marks)
            yield from (f"    {wait.start} {wait.end}: {wait.title()}" for wait in bar.waits)
            yield from [f"    {bar.reason(200)}"] * (bar.why is not None)


def trace_of(run: Run) -> Read:
    """Write the Perfetto trace of a run, and read it back."""
    stream = io.BytesIO()
    write_trace(run, stream)
    return read_trace(stream.getvalue())


def track_lines(read: Read) -> Iterator[str]:
    """Yield the tracks of a trace with their slices, arrows and counters."""
    for track, slices in groupby(
        sorted(read.slices, key=attrgetter("track", "lane", "start")), key=attrgetter("track")
    ):
        yield track
        for one in slices:
            details = ", ".join(f"{key}: {value}" for key, value in one.details.items())
            yield f"{'  ' * (one.depth + 1)}{one.start / SECOND:.3f}{_until(one)} {one.category}: {one.name}; {details}"
    for number, stations in sorted(read.flows.items()):
        yield f"arrow {number}: {' -> '.join(f'{one.name} ({one.track})' for one in stations)}"
    for counter, values in read.counters.items():
        yield f"{counter}: {', '.join(f'{number} at {time / SECOND}' for time, number in values)}"


def trace(run: Run) -> list[str]:
    return list(track_lines(trace_of(run)))


def _until(one: Slice) -> str:
    if one.end is None:
        return " on"
    return "" if one.end == one.start else f" to {one.end / SECOND:.3f}"


def tree(run: Run, at: float | None = None) -> list[str]:
    then = at_instant(run, at)
    return [unstyle(line) for line in tree_lines(then, whole_outline(then), width=None)]


def shown(run: Run, number: int) -> list[str]:
    """Return a story as it is printed."""
    return [
        line
        for text in story_lines(run, TaskId(number), 200)
        for line in unstyle(text).splitlines()
    ]


def run_summary(run: Run) -> list[str]:
    """Return the outcome of a run."""
    found, named = summary(run), {"last": last_task(run), "longest": longest_task(run)}
    is_good = "good" if found.is_good else "not good"
    return [
        f"{found.outcome} ({is_good}; {found.failures} failures, {found.modules} modules, {found.start:g} to {found.end:g})",
        ", ".join(f"{number} {state}" for state, number in found.tasks.items()),
        ", ".join(f"{title} {task}" for title, task in named.items()),
        *(f"dropped: {number} of {message}" for message, number in found.dropped),
    ]


def runs(run: Run) -> list[str]:
    """Return the times of handlings, queueings and claims."""
    lines = []
    for one in run.handlings:
        lines.append(
            f"{one.name} in {one.module}: {one.start:.6g} to {one.end and f'{one.end:.6g}'} {one.outcome}"
        )
        lines += [
            f"  waits for {wait.awaited} from {wait.start:.6g} to {wait.end}" for wait in one.waits
        ]
    lines += [
        f"{one.message_id} queued for {one.module}: {one.start:.6g} to {one.end and f'{one.end:.6g}'}"
        for one in run.queueings
    ]
    return lines + [
        f"claim of {one.resource}: {one.start:g}, {one.granted}, {one.end} {one.ended}"
        for one in run.claims.values()
    ]


def all_uses(run: Run) -> list[str]:
    """Return the use of each resource."""
    return [
        f"{one.name} of {one.key[0]}: {one.handled} handled, {one.busy:.3g} s busy ({one.share:.0%} of {one.capacity}), locked"
        f" {one.locked:.3g} s; {one.queued} queued for {one.queue_seconds:.3g} s, at most {one.longest_queue}, now {one.waiting}"
        for one in uses(run, *span_of(run))
    ]


def life(run: Run, number: int, at: float | None = None) -> list[str]:
    """Return the states of a task with their times, or the task's state and data at an instant."""
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
    bodies = {
        "progress": then.progress,
        "asked": then.asked,
        "data": RunAt(run, at).tasks[TaskId(number)].body,
    }
    known = [f"{name} {msgspec.msgpack.decode(text)}" for name, text in bodies.items() if text]
    return [", ".join([f"{then.state}, {then.serial}", *known])]


def messages(run: Run, number: int) -> list[str]:
    """Return the messages that belong to a task."""
    return [f"{run.name(one)} {{{one}}}" for one in sorted(messages_of(run, [TaskId(number)]))]


def waited(run: Run, number: int) -> list[str]:
    """Return the messages that a message waited for."""
    return [str(int(one)) for one in sorted(waited_for(run, TaskId(number), {TaskId(number)}))]


def figures(run: Run, at: float | None = None) -> list[str]:
    """Return counts and times of the part of a run that begins at an instant."""
    found = measure(run, start=at)
    lines = [f"{found.deadlocks} deadlocks"]
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
        lines.append("; ".join([f"{named}: {', '.join(counts)}", *times, *use]))
    return lines


def rows(table: Table, run: Run) -> list[str]:
    """Return the rows of an exported table, without empty cells."""
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
    "story": story_of,
    "row": row,
    "states": states,
    "end": final_wait,
    "causes": all_causes,
    "chain": chain,
    "failures": all_failures,
    "fate": fate_of,
    "continued": continued,
    "path": path,
    "shares": path_shares,
    "waits": waits,
    "reasons": all_reasons,
    "advice": advice,
    "bars": bars,
    "tree": tree,
    "shown": shown,
    "trace": trace,
    "summary": run_summary,
    "runs": runs,
    "uses": all_uses,
    "life": life,
    "messages": messages,
    "waited": waited,
    "figures": figures,
    **{f"table_{table.name}": partial(rows, table) for table in TABLES},
}
