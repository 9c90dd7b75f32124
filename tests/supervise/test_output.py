"""Output of many programs: whole named lines, and no program waits for a reader."""

import os
import threading
from pathlib import Path

from module.real_central import until

from tca_tools.supervise.output import LONGEST_LINE, MOST_WAITING, Lines, Output


def test_output_lines_are_whole_or_cut() -> None:
    printed: list[bytes] = []
    lines = Lines(printed.append)
    for data in (b"one\ntw", b"o\r\n\n", b"x" * (LONGEST_LINE + 1) + b"\n", b"no end"):
        lines.feed(data)
    lines.close()
    assert (
        printed == list(lines.last) == [b"one", b"two", b"", b"x" * (LONGEST_LINE + 1), b"no end"]
    )


def test_endless_line_is_printed_in_pieces() -> None:
    lengths: list[int] = []
    Lines(lambda piece: lengths.append(len(piece))).feed(b"x" * (2 * LONGEST_LINE + 5))
    assert lengths == [LONGEST_LINE, LONGEST_LINE]


def test_output_lines_have_their_program_name(tmp_path: Path) -> None:
    for in_colour, first in (
        (False, b"run  | hello\n"),
        (True, b"\x1b[36mrun  | \x1b[0mhello\x1b[0m\n"),
    ):
        with (tmp_path / "screen").open("wb") as screen:
            output = Output(["run", "legs"], screen.fileno(), in_colour=in_colour)
            output.start()
            output.show("run", b"hello")
            output.show("legs", b"x\xff")
            output.close(10)
        assert (tmp_path / "screen").read_bytes().startswith(first)


def test_stalled_reader_blocks_no_program_and_learns_its_gap() -> None:
    read, write = os.pipe()
    output = Output(["run"], write, in_colour=False)
    output.start()
    line, sent = b"x" * 1000, 0
    while not output._dropped:
        output.show("run", line)
        sent += 1
    assert sent < 2 * MOST_WAITING / len(line) + 200
    heard = bytearray()
    reader = threading.Thread(
        target=lambda: heard.extend(b"".join(iter(lambda: os.read(read, 1 << 20), b"")))
    )
    reader.start()
    until(lambda: not output._waiting, "all is taken")
    output.show("run", b"again")
    output.close(10)
    os.close(write)
    reader.join()
    os.close(read)
    assert b"1 lines of all programs were dropped" in heard
    assert heard.endswith(b"again\n")
