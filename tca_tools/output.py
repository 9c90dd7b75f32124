"""Where a tool's result goes when it has a file name: the file, or one line that says why not."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from tca_tools.errors import ToolError


def write_output(path: Path, content: str | bytes) -> None:
    """Write a whole file, or leave what was there. Raises ToolError if it can't be written."""
    with new_file(path) as stream:
        stream.write(content if isinstance(content, bytes) else content.encode())


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A file to be written bit by bit. It has its name only when all is written: no half of one looks like a whole.

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
    """What is done here is done to write that file, such as drawing: ToolError says which can't be written."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{path}: can't be written: {error.strerror}") from None


def make_folder(path: Path) -> None:
    """See to it that there is a folder of that name. Raises ToolError if that can't be done."""
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise ToolError(f"{path}: no folder can be made there: {error.strerror}") from None
