"""The generated reference of the command line, in the order of ``tca --help``."""

import re
from collections.abc import Iterator

import click

from dev.site.markdown import code, flowing, table
from tca_tools.command_line import GROUPS, main

PARAGRAPHS = re.compile(r"\n\s*\n")


def command_line() -> str:
    """Return all commands, with usage, options and help."""
    context = click.Context(main, info_name="tca")
    names = main.list_commands(context)
    listed = [name for group in GROUPS.values() for name in group]
    groups = {**GROUPS, "More": [name for name in names if name not in listed]}
    parts = []
    for title, group in groups.items():
        parts.append(f"## {title}\n\n")
        for name in group:
            found = main.get_command(context, name)
            assert found is not None, name
            parts += described(found, click.Context(found, context, name), 3)
    return "".join(parts)


def described(command: click.Command, context: click.Context, level: int) -> Iterator[str]:
    """Yield the description of a command and its subcommands."""
    yield f"{'#' * level} {context.command_path}\n\n"
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    yield f"```text\n{usage}\n```\n\n"
    yield from text(command.help or "")
    rows = [(one, *record) for one in command.get_params(context) if (record := row(one, context))]
    if rows:
        yield table(("option", "meaning"), [row[1:] for row in rows]) + "\n"
    yield from text(command.epilog or "")
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None, name
            yield from described(found, click.Context(found, context, name), level + 1)


def row(parameter: click.Parameter, context: click.Context) -> tuple[str, str] | None:
    """Return an option and its meaning; None for an argument, which the help explains."""
    record = parameter.get_help_record(context)
    if record is None or not record[1] or "--help" in parameter.opts:
        return None
    names, meaning = record
    return code(names), escaped(meaning)


def text(given: str) -> Iterator[str]:
    """Yield the paragraphs of a help. Those that start with a backspace keep their lines."""
    for paragraph in PARAGRAPHS.split(given.replace("\f", "").strip()):
        if paragraph.startswith("\b"):
            lines = paragraph.removeprefix("\b").strip("\n")
            yield f"```text\n{lines}\n```\n\n"
        elif paragraph:
            yield f"{escaped(flowing(paragraph))}\n\n"


def escaped(words: str) -> str:
    """Return a text of the help whose stars, brackets and the like are no Markdown."""
    return re.sub(r"([*_<>\[\]`])", r"\\\1", words)
