"""``tca explore``: explores the scenarios of a file."""

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
    help="States after which a scenario is given up.",
)
@click.pass_context
def explore_file(context: click.Context, path: Path, limit: int) -> None:
    """Explore every interleaving of small scenarios.

    FILE is a Python file, which may import what lies beside it; each Scenario at its top level is
    explored with its properties. Exit code 0 says that all of them hold in all runs, 1 that one
    does not or is not known, 2 that one can't be explored; the others are.
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
    """A function that shows the progress, in a line that is gone in the end; None if stderr is no
    terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return

    def show(states: int, to_go: int) -> None:
        click.echo(
            f"\r\x1b[K{title}: {states:,} states, {to_go:,} of them to go on from",
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
            f"{path} has no scenario: make a tca_tools.explore.Scenario at its top level"
        )
    return found
