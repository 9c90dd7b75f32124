"""``tca explore``: explore the scenarios of a file."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from tca_tools.explore.errors import ScenarioError
from tca_tools.explore.scenario.scenario import Scenario
from tca_tools.explore.search.exploration import LIMIT, explore
from tca_tools.explore.search.transcript import report
from tca_tools.user_file import names_of


@click.command("explore")
@click.argument(
    "path", metavar="FILE", type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@click.option(
    "--limit",
    metavar="N",
    type=click.IntRange(1),
    default=LIMIT,
    show_default=True,
    help="Stop exploring a scenario after N states.",
)
@click.pass_context
def explore_file(context: click.Context, path: Path, limit: int) -> None:
    """Explore every interleaving of small scenarios.

    FILE is a Python file, which may import modules from its own folder. Each Scenario at its top
    level is explored with its properties.

    Exit codes: 0 if all properties hold in all runs, 1 if one does not hold or the limit is
    reached, 2 if a scenario can't be explored (the others are explored all the same).
    """
    code = 0
    for scenario in _scenarios(path):
        try:
            with _progress(scenario.title) as watch:
                result = explore(scenario, limit=limit, watch=watch)
        except ScenarioError as error:
            click.echo(f"tca: {path}: scenario '{scenario.title}': {error}", err=True)
            code = 2
            continue
        click.echo(report(result))
        code = max(code, int(not result.ok))
    context.exit(code)


@contextmanager
def _progress(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """Yield a function that shows the progress in one line; None if stderr is not a terminal.

    The line is erased at the end.
    """
    if not sys.stderr.isatty():
        yield None
        return

    def show(states: int, unexpanded: int) -> None:
        click.echo(
            f"\r\x1b[K{title}: {states:,} states, {unexpanded:,} not yet explored further",
            err=True,
            nl=False,
        )

    try:
        yield show
    finally:
        click.echo("\r\x1b[K", err=True, nl=False)


def _scenarios(path: Path) -> list[Scenario]:
    found = [value for value in names_of(path).values() if isinstance(value, Scenario)]
    if not found:
        raise click.UsageError(
            f"{path} has no scenario: create a tca_tools.explore.Scenario at its top level"
        )
    return found
