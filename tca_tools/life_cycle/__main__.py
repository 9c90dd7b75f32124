"""``tca lifecycle``: the states that a task goes through, and who takes which transition."""

from pathlib import Path

import click

from tca_tools.drawing.graphviz import drawn
from tca_tools.drawing.page import zoomed_page
from tca_tools.life_cycle.dot import dot_source
from tca_tools.life_cycle.found import meant
from tca_tools.life_cycle.table import table_lines
from tca_tools.options import check_output, force_option, log_argument, output_option
from tca_tools.output import made_for, show_text, write_output
from tca_tools.terminal import line_width
from tca_wire.life_cycles import LifeCycle

KINDS = (".svg", ".png", ".pdf", ".html", ".dot", ".txt")


@click.command()
@click.argument("what", metavar="[WHAT]", default="general")
@log_argument
@output_option("A diagram: .svg, .png, .pdf, .html or .dot; or the table as .txt.")
@force_option
def lifecycle(what: str, log_path: Path | None, output: Path | None, *, force: bool) -> None:
    """Show the life cycle of tasks: as a table, or with -o as a diagram.

    WHAT is "general" (what goals and commands have if nothing else is declared), "basic", a Python file that declares
    life cycles or messages, or the name of a goal or command of a run. LOG is that run's journal; without it, the
    newest run is asked.
    """
    check_output(output, KINDS, force=force)
    found = meant(what, log_path)
    if output is None or output.suffix == ".txt":
        width = None if output else line_width()
        tables = ["\n".join(table_lines(one, width)) for one in found]
        show_text("\n\n".join(tables), output)
        return
    if len(found) > 1:
        names = ", ".join(one.name for one in found)
        raise click.UsageError(f"{what} has {len(found)} life cycles ({names}): a diagram shows one")
    write_output(output, _picture(found[0], output))


def _picture(life_cycle: LifeCycle, output: Path) -> str | bytes:
    source, kind = dot_source(life_cycle), output.suffix[1:]
    if kind == "dot":
        return source
    with made_for(output):
        picture = drawn(source, "svg" if kind == "html" else kind)
    if kind == "html":
        return zoomed_page(f"life cycle '{life_cycle.name}'", picture.decode())
    return picture


if __name__ == "__main__":
    lifecycle(prog_name="python -m tca_tools.life_cycle")
