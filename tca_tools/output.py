"""Where a tool's result goes when it has a file name: the file, or one line that says why not."""

from pathlib import Path

from tca_tools.errors import ToolError


def write_output(path: Path, content: str | bytes) -> None:
    """Write a whole file. Raises ToolError if that can't be done."""
    try:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    except OSError as error:
        raise ToolError(f"{path}: can't be written: {error.strerror}") from None
