"""Where a tool's result goes when it has a file name: the file, or one line that says why not.

A report, chart or tree is made over and over, so what a command of ours has written may be written
over, without a word. All else that is there may not, unless that is asked for, and a segment of a
journal never. What is ours is known by a mark at its end, which readers of these formats skip; an
export by what it begins with.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

import click

from tca_tools.errors import ToolError
from tca_wire.journal.records import SEGMENT_SUFFIX

_MARK = b"made by tca"
_TAIL = 100
"""The mark is among the last bytes."""
_MARKS = {
    **dict.fromkeys((".html", ".htm", ".svg"), b"<!-- " + _MARK + b" -->\n"),
    ".dot": b"// " + _MARK + b"\n",
    ".pdf": b"\n% " + _MARK + b"\n",
    ".png": b"\n" + _MARK + b"\n",
    ".txt": _MARK + b"\n",
}


def check_free(path: Path, *, begins: bytes = b"", force: bool = False) -> None:
    """See, before long work, that nothing would be destroyed. Raises ToolError if there is a file
    that no command of ours has written (an export is known by what it *begins* with; *force*:
    whatever it is), or a segment of a journal.
    """
    if path.suffix == SEGMENT_SUFFIX:
        raise ToolError(f"{path}: a journal's name: give another one")
    with made_for(path):  # of a name that is too long it can't even be asked
        is_free, is_file = path.is_dir() or not path.exists(), path.is_file()
    if is_free:
        return
    if not is_file:
        raise ToolError(f"{path}: neither a file nor a folder: give another name")
    if not force and not _is_ours(path, begins):
        raise ToolError(
            f"{path}: exists already, and was not made by this command: give another name, or --force to write over it"
        )


def _is_ours(path: Path, begins: bytes) -> bool:
    with made_for(path), path.open("rb") as stream:
        if begins:
            return stream.read(len(begins)) in (begins, b"")
        size = stream.seek(0, 2)
        stream.seek(max(size - _TAIL, 0))
        return not size or _MARK in stream.read()


def write_output(path: Path, content: str | bytes) -> None:
    """Write a whole file, with our mark, or leave what was there. Raises ToolError if it can't be
    written.
    """
    with new_file(path) as stream:
        stream.write(content if isinstance(content, bytes) else content.encode())
        stream.write(_MARKS.get(path.suffix, b""))


def show_text(text: str, path: Path | None) -> None:
    """Print a text, or write it without its colours to a file. Raises ToolError if it can't be
    written.
    """
    click.echo(text) if path is None else write_output(path, f"{click.unstyle(text)}\n")


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A file to be written bit by bit. It has its name only when all is written: no half of one
    looks like a whole.

    Raises ToolError if it can't be written.
    """
    unfinished = path.with_name(f"{path.name}.part")
    try:
        with made_for(path), unfinished.open("wb") as stream:
            yield stream
        with made_for(path):
            unfinished.replace(path)
    finally:
        with suppress(OSError):  # there is none where it could not be made
            unfinished.unlink(missing_ok=True)


@contextmanager
def made_for(path: Path) -> Iterator[None]:
    """A context for making that file, such as drawing it: ToolError says which can't be written."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{path}: can't be written: {error.strerror}") from None
