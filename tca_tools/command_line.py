"""The command ``tca``: finds its sub-commands among the installed packages.

A sub-command is an entry point of the group "tca.commands"; it is imported when it is used, or
listed in the help.
"""

import errno
import io
import os
import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import click
from click.shell_completion import get_completion_class

from tca_wire.endpoint import NoHome
from tca_wire.release import release
from tca_wire.standard_streams import replace_closed_streams
from tca_wire.text.nearest import did_you_mean

COMMANDS = "tca.commands"
_GROUPS = {
    "Run": (
        "central", "run", "keys", "status", "top", "modules", "messages", "variables", "attached", "activities",
    ),
    "Send and steer": (
        "send", "query", "get", "set", "update", "cancel", "watch", "kill", "suspend", "resume", "retry", "raise",
        "unlock", "detach", "console", "activities",
    ),
    "See a run, live or afterwards": (
        "view", "tree", "gantt", "schedule", "report", "replay", "log", "stats", "check", "export",
    ),
    "Try a robot before it moves": ("explore", "lifecycle", "generate"),
}  # fmt: skip
"""How the help lists the commands; those of other packages come last."""
_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EIO)


class CommandLine(click.Group):
    """A group whose commands come from entry points."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, the built-in ones too."""
        return sorted({*super().list_commands(ctx), *entry_points(group=COMMANDS).names})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, imported now."""
        found = entry_points(group=COMMANDS, name=cmd_name)
        return super().get_command(ctx, cmd_name) or next(map(_load, found), None)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands in groups, each with the first words of its help."""
        names = self.list_commands(ctx)
        others = [name for name in names if not any(name in group for group in _GROUPS.values())]
        column = max(map(len, names), default=0)
        width = formatter.width - column - 6
        for title, group in {**_GROUPS, "More": others}.items():
            found = [(name, self.get_command(ctx, name)) for name in group]
            rows = [
                (name.ljust(column), one.get_short_help_str(width))
                for name, one in found
                if one is not None
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the arguments name. Raises UsageError, with the nearest name, if there
        is none.
        """
        known = self.list_commands(ctx)
        if not (args[0] in known or args[0].startswith("-") or ctx.resilient_parsing):
            advice = did_you_mean(args[0], known) or "'tca --help' lists them"
            raise click.UsageError(f"no command '{args[0]}': {advice}", ctx)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command. Output that finds no room is an error of one line."""
        replace_closed_streams()
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(
                errors="backslashreplace"
            )  # names may have characters that a terminal has not
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
        except NoHome as error:
            raise click.ClickException(str(error)) from None
        except OSError as error:
            if error.filename is not None or error.errno not in _NO_ROOM:
                raise
            os.dup2(
                os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
            )  # or it fails again when the program ends
            raise click.ClickException(
                f"the output can't be written: {error.strerror}: make room"
            ) from None
        return result


@click.group(
    cls=CommandLine, epilog="'tca completion --help' tells how the shell completes these commands."
)
@click.version_option(release(), prog_name="tca")
def main() -> None:
    """Task Control Architecture: run, watch and understand robots of many programs."""


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the code that makes a shell complete 'tca'.

    \b
    bash:  eval "$(tca completion bash)"      in ~/.bashrc
    zsh:   eval "$(tca completion zsh)"       in ~/.zshrc
    fish:  tca completion fish | source       in ~/.config/fish/config.fish

    The same as _TCA_COMPLETE=bash_source tca.
    """  # noqa: D301 - click wants the character itself
    kind = get_completion_class(shell)
    assert kind is not None
    click.echo(kind(main, {}, "tca", "_TCA_COMPLETE").source())


def _load(entry_point: EntryPoint) -> click.Command:
    """The command of an entry point; one that can't be imported says so when it is used."""
    try:
        command: click.Command = entry_point.load()
    except (ImportError, AttributeError) as error:
        return _broken(
            entry_point.name,
            f"command '{entry_point.name}' can't be loaded ({error}): install tca anew",
        )
    return command


def _broken(name: str, why: str) -> click.Command:
    @click.command(
        name, short_help="(can't be loaded)", context_settings={"ignore_unknown_options": True}
    )
    @click.argument("_arguments", nargs=-1)
    def broken(_arguments: tuple[str, ...]) -> None:
        raise click.ClickException(why)

    return broken
