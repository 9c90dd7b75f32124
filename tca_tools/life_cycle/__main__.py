"""``tca lifecycle``: the states of a task, and its transitions with their parties."""

from pathlib import Path

import click

from tca_tools.drawing.pictures import write_graph
from tca_tools.life_cycle.dot import dot_source
from tca_tools.life_cycle.found import find_life_cycles
from tca_tools.life_cycle.table import life_cycle_lines
from tca_tools.options import check_output, force_option, log_argument, output_option
from tca_tools.output import show_text
from tca_tools.terminal import line_width

KINDS = (".svg", ".png", ".pdf", ".html", ".dot", ".txt")


@click.command()
@click.argument("what", metavar="[WHAT]", default="general")
@log_argument
@output_option("A diagram: .svg, .png, .pdf, .html or .dot; or the table as .txt.")
@force_option
def lifecycle(what: str, log_path: Path | None, output: Path | None, *, force: bool) -> None:
    """Show the life cycle of tasks: as a table, or with -o as a diagram.

    WHAT is "general" (the default of goals and commands), "basic", "one update", "ros goal", a
    Python file that declares life cycles or messages, or the name of a goal or command in LOG.
    """
    check_output(output, KINDS, force=force)
    found = find_life_cycles(what, log_path)
    if output is None or output.suffix == ".txt":
        width = None if output else line_width()
        tables = ["\n".join(life_cycle_lines(one, width)) for one in found]
        show_text("\n\n".join(tables), output)
        return
    if len(found) > 1:
        names = ", ".join(one.name for one in found)
        raise click.UsageError(
            f"{what} has {len(found)} life cycles ({names}), but a diagram shows only one"
        )
    write_graph(output, dot_source(found[0]), f"life cycle '{found[0].name}'")


if __name__ == "__main__":
    lifecycle(prog_name="python -m tca_tools.life_cycle")
