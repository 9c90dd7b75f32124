"""The command ``tca``: finds its sub-commands among the installed packages, and shows errors as one line.

A sub-command is an entry point of the group "tca.commands"; it is imported when it is used, or listed in the help.
"""

import errno
import io
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NoReturn

import click
from click.shell_completion import get_completion_class

from tca_wire.endpoint import NoHome
from tca_wire.release import release
from tca_wire.standard_streams import replace_closed_streams

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
_COMPLETION_VARIABLE = "_TCA_COMPLETE"
_WORDS_OF_CLICK = re.compile(
    r"Invalid |Missing |No such |Got unexpected |Could not open |Option '|Argument '|Value must"
)
"""How messages of click begin."""
_INTERRUPTED = 130
_NOBODY_READS = 141
"""The shell's exit code of a program that wrote into a closed pipe."""


class CommandLine(click.Group):
    """A group whose commands come from entry points and whose errors are one line: what, which, what to do."""

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
        for title, group in {**_GROUPS, "More": others}.items():
            found = [(name, self.get_command(ctx, name)) for name in group]
            width = formatter.width - column - 6
            rows = [
                (name.ljust(column), command.get_short_help_str(width))
                for name, command in found
                if command is not None
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the arguments name. Raises UsageError, with the nearest name, if there is none."""
        if not args[0].startswith("-") and self.get_command(ctx, args[0]) is None and not ctx.resilient_parsing:
            nearest = get_close_matches(args[0], self.list_commands(ctx), n=1)
            advice = f"did you mean '{nearest[0]}'?" if nearest else f"'{ctx.command_path} --help' lists them"
            if not entry_points(group=COMMANDS):
                advice = "tca is not installed: install its folder with pip"
            raise click.UsageError(f"no command '{args[0]}': {advice}", ctx)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command. A reader that goes away ends it quietly."""
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="backslashreplace")  # names may have characters that a terminal has not
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
        except BrokenPipeError:
            _discard_output()
            ctx.exit(_NOBODY_READS)
        return result

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = "tca",
        complete_var: str | None = _COMPLETION_VARIABLE,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run from the command line, and end the program (unless *standalone_mode* is off)."""
        replace_closed_streams()
        try:
            with _explained():
                result = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        except click.Abort:
            sys.exit(_INTERRUPTED)
        except click.ClickException as error:
            if not standalone_mode:
                raise
            _complain(error)
        if not standalone_mode:
            return result
        sys.exit(result if isinstance(result, int) else 0)


@click.group(cls=CommandLine, epilog="'tca completion --help' tells how the shell completes these commands.")
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
    click.echo(kind(main, {}, "tca", _COMPLETION_VARIABLE).source())


def _load(entry_point: EntryPoint) -> click.Command:
    """The command of an entry point; one that can't be imported says so when it is used."""
    try:
        command: click.Command = entry_point.load()
    except (ImportError, AttributeError) as error:
        return _broken(entry_point.name, f"command '{entry_point.name}' can't be loaded ({error}): install tca anew")
    return command


def _broken(name: str, why: str) -> click.Command:
    @click.command(name, short_help="(can't be loaded)", context_settings={"ignore_unknown_options": True})
    @click.argument("_arguments", nargs=-1)
    def broken(_arguments: tuple[str, ...]) -> NoReturn:
        raise click.ClickException(why)

    return broken


@contextmanager
def _explained() -> Iterator[None]:
    """A line for what any command may meet: output that can't be written, or a user without a home folder."""
    try:
        yield
    except NoHome as error:
        raise click.ClickException(str(error)) from None
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EFBIG, errno.EIO) or error.filename is not None:
            raise
        _discard_output()
        raise click.ClickException(f"the output can't be written: {error.strerror}: make room") from None


def _complain(error: click.ClickException) -> NoReturn:
    text = error.format_message()
    if not text.startswith("Usage:"):  # a command without its arguments shows its help
        text = f"tca: {_advised(error, ' '.join(text.split()))}"
    with suppress(OSError):  # nor may that be written
        click.echo(text, err=True)
    sys.exit(error.exit_code)


def _advised(error: click.ClickException, message: str) -> str:
    """Messages of click in our style: lower case, and what to do."""
    if isinstance(error, click.NoSuchOption) and error.option_name[1:2].isdecimal():
        return f"'{error.option_name}' looks like an option: write '--' before what begins with a minus"
    if _WORDS_OF_CLICK.match(message):  # others may begin with a name
        message = f"{message[:1].lower()}{message[1:].rstrip('.')}"
    if not isinstance(error, click.UsageError) or not error.ctx or "--help" in message:
        return message
    return f"{message.rstrip('.')}; see '{error.ctx.command_path} --help'"


def _discard_output() -> None:
    """Let nothing that is still buffered fail again when the program ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
