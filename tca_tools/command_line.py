"""The command ``tca``, which finds its subcommands among the installed packages.

A subcommand is an entry point of the group "tca.commands". It is imported when it is used or listed
in the help.
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
GROUPS = {
    "Run": (
        "central", "standby", "run", "keys", "status", "top", "modules", "messages", "variables",
        "attached", "activities",
    ),
    "Send and steer": (
        "send", "query", "get", "set", "update", "cancel", "watch", "kill", "suspend", "resume",
        "retry", "raise", "unlock", "detach", "console",
    ),
    "See a run, live or afterwards": (
        "view", "tree", "gantt", "schedule", "report", "replay", "log", "stats", "check", "export",
    ),
    "Try a robot before it moves": ("explore", "lifecycle", "generate"),
}  # fmt: skip
"""The groups of commands in the help. Commands of other packages come last."""
_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EIO)


class CommandLine(click.Group):
    """A group whose commands come from entry points."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return all names, with the built-in ones."""
        return sorted({*super().list_commands(ctx), *entry_points(group=COMMANDS).names})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command of that name."""
        found = entry_points(group=COMMANDS, name=cmd_name)
        return super().get_command(ctx, cmd_name) or next(map(_load, found), None)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands in groups, each with the first words of its help."""
        names = self.list_commands(ctx)
        others = [name for name in names if not any(name in group for group in GROUPS.values())]
        column = max(map(len, names), default=0)
        width = formatter.width - column - 6
        for title, group in {**GROUPS, "More": others}.items():
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
        """Return the command that the arguments name.

        Raises UsageError, with the nearest name, if there is none.
        """
        known = self.list_commands(ctx)
        if not (args[0] in known or args[0].startswith("-") or ctx.resilient_parsing):
            advice = did_you_mean(args[0], known) or "'tca --help' lists them"
            raise click.UsageError(f"no command '{args[0]}': {advice}", ctx)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command. A full disk or a closed output is an error of one line."""
        replace_closed_streams()
        if isinstance(sys.stdout, io.TextIOWrapper):
            # names may contain characters that the terminal's encoding lacks
            sys.stdout.reconfigure(errors="backslashreplace")
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
        except NoHome as error:
            raise click.ClickException(str(error)) from None
        except OSError as error:
            if error.filename is not None or error.errno not in _NO_ROOM:
                raise
            # Python flushes standard output at exit: that would fail again
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise click.ClickException(
                f"the output can't be written: {error.strerror}: make room"
            ) from None
        return result


@click.group(
    cls=CommandLine, epilog="'tca completion --help' shows how to complete commands in the shell."
)
@click.version_option(release(), prog_name="tca")
def main() -> None:
    """Task Control Architecture: run, watch and understand robots of many programs."""


@main.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the shell code that completes 'tca' commands.

    \b
    bash:  eval "$(tca completion bash)"      in ~/.bashrc
    zsh:   eval "$(tca completion zsh)"       in ~/.zshrc
    fish:  tca completion fish | source       in ~/.config/fish/config.fish

    The same as _TCA_COMPLETE=bash_source tca.
    """  # noqa: D301 - click needs the character itself
    kind = get_completion_class(shell)
    assert kind is not None
    click.echo(kind(main, {}, "tca", "_TCA_COMPLETE").source())


def _load(entry_point: EntryPoint) -> click.Command:
    """Import the command of an entry point, or return one that reports the failed import."""
    name = entry_point.name
    try:
        command: click.Command = entry_point.load()
    except (ImportError, AttributeError) as error:
        why = f"command '{name}' can't be loaded ({error}): install tca again"
    else:
        return command

    @click.command(
        name, short_help="(can't be loaded)", context_settings={"ignore_unknown_options": True}
    )
    @click.argument("_arguments", nargs=-1)
    def broken(_arguments: tuple[str, ...]) -> None:
        raise click.ClickException(why)

    return broken


if __name__ == "__main__":
    main()
