"""``tca gantt``: what each module did when, on the terminal or as a picture."""

from pathlib import Path

import click

from tca_tools.drawing.pictures import write_svg
from tca_tools.gantt.build import chart
from tca_tools.gantt.cells import blocks_for, width_for
from tca_tools.gantt.chart import Chart
from tca_tools.gantt.svg import page_text, svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.gantt.window import MARGIN_SHARE, Pick
from tca_tools.journal.fold import folded, no_garbage
from tca_tools.journal.journals import open_log
from tca_tools.journal.records import OVER, Task
from tca_tools.journal.selection import (
    check_modules,
    messages_of,
    one_task,
    subtree,
    tasks_called,
    waited_for,
)
from tca_tools.journal.whole_run import Run
from tca_tools.options import Asked, check_output, check_span, output_option, shared_options
from tca_tools.output import show_text, write_output
from tca_tools.terminal import cut
from tca_wire.points import Moment
from tca_wire.text.printable import printable

_KINDS = (".svg", ".png", ".pdf", ".html", ".txt")


@click.command()
@shared_options
@click.option(
    "--story",
    metavar="TASK",
    help="Only this task, its subtasks and, paler, the tasks that it waited for.",
)
@output_option(".svg, .png, .pdf, .html or .txt")
@click.option("--ascii", "as_ascii", is_flag=True, help="Draw bars with ASCII characters.")
def gantt(asked: Asked, story: str | None, output: Path | None, *, as_ascii: bool) -> None:
    """Show what each module did when."""
    check_output(output, _KINDS, force=asked.force)
    if asked.task is not None and story:
        raise click.UsageError("--task and --story exclude each other: use one of them")
    journal = open_log(asked.log_path)
    history = folded(journal, asked.at)
    check_span(asked.start, history.time if asked.end is None else asked.end)
    with no_garbage():
        drawing = chart(history, asked.start, asked.end, _picked(history, asked, story))
    title = _title(journal.name, drawing, asked.task, story)
    title += " (still running)" * (history.is_live and drawing.end >= history.time)
    if output is None or output.suffix == ".txt":
        width, blocks = width_for(output), blocks_for(output, as_ascii=as_ascii)
        show_text("\n".join([cut(title, width), *chart_lines(drawing, width, blocks)]), output)
    elif output.suffix == ".html":
        write_output(output, page_text(drawing, title))
    else:
        write_svg(output, svg_text(drawing, title))
    journal.check()


def _title(name: str, drawing: Chart, task: str | None, story: str | None) -> str:
    subject = f", story of {printable(story)}" if story else ""
    if task is not None:
        subject = f", task {printable(task)}"
    return f"{printable(name)}{subject}: {drawing.start:.2f} to {drawing.end:.2f} s"


def _picked(run: Run, asked: Asked, story: str | None) -> Pick:
    """Return the selection that the options ask for; raise NotInLog for an unknown name."""
    check_modules(run, asked.modules)
    rows = frozenset(asked.modules) if asked.modules else None
    if story:
        number = one_task(run, story)
        wanted = messages_of(run, subtree(run, [number]))
        context, life = waited_for(run, number, wanted), _life(run, run.tasks[number])
        return Pick(rows, wanted, context, wanted, *life)
    if asked.task is not None:
        return Pick(rows, messages_of(run, subtree(run, tasks_called(run, asked.task))))
    return Pick(rows)


def _life(run: Run, task: Task) -> tuple[float, float | None]:
    """Return when a task was sent, and the end of its chart (None: the task is open).

    The chart ends a little after the task, to show what happens to the tasks that it waited for.
    """
    if task.state not in OVER:
        return task.received, None
    end = max(task.stage(-1)[0], task.reached.get(Moment.END_ACHIEVING, 0.0))
    return task.received, min(end + (end - task.received) * MARGIN_SHARE, run.time)


if __name__ == "__main__":
    gantt(prog_name="python -m tca_tools.gantt")
