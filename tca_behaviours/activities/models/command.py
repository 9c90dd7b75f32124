"""``tca generate``: converts the model of an application to Python, or draws it."""

from pathlib import Path

import click

from tca_behaviours.activities.models.dot import model_dot
from tca_behaviours.activities.models.reading import read_model
from tca_behaviours.activities.models.writing import write_code
from tca_tools.drawing.pictures import write_machine

KINDS = (".svg", ".png", ".pdf", ".dot")


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Another folder for the files; or the file of a picture: .svg, .png, .pdf or .dot.",
)
def generate(model: Path, output: Path | None) -> None:
    """Write the Python of an application of periodic activities, or draw it.

    MODEL is a TOML file of components, ports, regions, states and activities. Its folder gets
    generated.py and application.py, which are overwritten each time. It also gets a file for each
    component, which is written only once and is yours to edit.

    The exit code is 2 when the model is wrong.
    """
    if output is not None and output.suffix not in ("", *KINDS) and not output.is_dir():
        raise click.UsageError(
            f"-o {output}: give a picture ({', '.join(KINDS)}), or a folder without a suffix"
        )
    try:
        read = read_model(model)
        if output is not None and output.suffix in KINDS:
            write_machine(output, model_dot(read))
            return
        lines = write_code(read, output or model.parent)
    except OSError as error:
        raise click.ClickException(f"{error.filename}: {error.strerror}") from None
    click.echo("\n".join(lines))
