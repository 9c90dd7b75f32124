"""Write a tool's result to a file.

A report, chart or tree is often made again, so a file that tca has made is overwritten silently.
Any other file is overwritten only on request, and a segment of a journal never. A file of tca has a
mark at its end, which programs that show the file ignore. An export has no mark, and is recognised
by its first bytes.
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
"""The number of last bytes that contain the mark."""
_MARKS = {
    **dict.fromkeys((".html", ".htm", ".svg"), b"<!-- " + _MARK + b" -->\n"),
    ".dot": b"// " + _MARK + b"\n",
    ".pdf": b"\n% " + _MARK + b"\n",
    ".png": b"\n" + _MARK + b"\n",
    ".txt": _MARK + b"\n",
}


def check_free(path: Path, *, begins: bytes = b"", force: bool = False) -> None:
    """Check, before long work, that no foreign file would be overwritten.

    Args:
        path: the file to write.
        begins: the first bytes of an export; b"": the file has tca's mark instead.
        force: whether to allow any file except a segment of a journal.

    Raises:
        ToolError: the file must not be overwritten.
    """
    if path.suffix == SEGMENT_SUFFIX:
        raise ToolError(f"{path} is the name of a journal's segment: give another name")
    with writing(path):  # `exists` fails for a name that is too long
        is_free, is_file = path.is_dir() or not path.exists(), path.is_file()
    if is_free:
        return
    if not is_file:
        raise ToolError(f"{path}: neither a file nor a folder: give another name")
    if not force and not _is_by_tca(path, begins):
        raise ToolError(
            f"{path}: exists already, and was not made by this command:"
            " give another name, or --force to overwrite it"
        )


def _is_by_tca(path: Path, begins: bytes) -> bool:
    with writing(path), path.open("rb") as stream:
        if begins:
            return stream.read(len(begins)) in (begins, b"")
        size = stream.seek(0, 2)
        stream.seek(max(size - _TAIL, 0))
        return not size or _MARK in stream.read()


def write_output(path: Path, content: str | bytes) -> None:
    """Write a file with tca's mark, atomically. Raises ToolError if it can't be written."""
    with new_file(path) as stream:
        stream.write(content if isinstance(content, bytes) else content.encode())
        stream.write(_MARKS.get(path.suffix, b""))


def show_text(text: str, path: Path | None) -> None:
    """Print a text, or write it without colours to a file. Raises ToolError."""
    click.echo(text) if path is None else write_output(path, f"{click.unstyle(text)}\n")


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A context that yields a file to write. It gets its name only when it is complete.

    Raises ToolError if it can't be written.
    """
    unfinished = path.with_name(f"{path.name}.part")
    try:
        with writing(path), unfinished.open("wb") as stream:
            yield stream
        with writing(path):
            unfinished.replace(path)
    finally:
        with suppress(OSError):  # it may not exist
            unfinished.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """A context for writing a file: it turns OSError into ToolError with the file's name."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{path}: can't be written: {error.strerror}") from None
