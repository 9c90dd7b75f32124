"""The pages of the tutorial: each is played in a folder with the files of the pages before it.

Printed lines that are quoted from ``examples/tutorial/printed`` can be rewritten.
"""

import os
import re
import time
from pathlib import Path

from docs.pages import DOCS, blocks
from docs.steps import File, Step, steps_of
from docs.terminals import Player, Terminal

PAGES = sorted((DOCS / "tutorial").glob("*.md"))


def save_files(page: Path, folder: Path) -> None:
    """Save all files of a page."""
    for step in steps_of(blocks(page)):
        if isinstance(step, File):
            (folder / step.name).write_text(step.text)


class TutorialPlayer(Player):
    """The reader of a page. *rewrite* replaces the quoted outputs by what is printed."""

    def __init__(self, page: Path, folder: Path, *, rewrite: bool = False) -> None:
        super().__init__(folder, all_numbers=page.stem.startswith("5"))
        self.rewrite = rewrite
        for earlier in PAGES[: PAGES.index(page)]:
            save_files(earlier, self.folder)

    def read(self, terminal: Terminal, step: Step) -> None:
        if self.rewrite and step.quoted is not None:
            self.write_anew(terminal, step)
        else:
            super().read(terminal, step)

    def write_anew(self, terminal: Terminal, step: Step) -> None:
        """Replace the quoted lines by those that are printed until nothing more comes."""
        assert step.quoted is not None
        begin = since = time.monotonic()
        seen = 0
        while time.monotonic() < min(since + 2.5, begin + 8) or not terminal.lines():
            if len(terminal.lines()) > seen:
                seen, since = len(terminal.lines()), time.monotonic()
            if terminal.foreground is not None and terminal.foreground.poll() is not None:
                break
            time.sleep(0.02)
        lines = terminal.lines()
        terminal.has_read += len(lines)
        if step.printed[0] == "...":
            lines = lines[1 - len(step.printed) :]
        text = "\n".join(lines) + "\n"
        text = text.replace(f"{self.folder.parent}/state", "/home/you/.local/state")
        text = text.replace(f"{self.folder.parent}/tca", "/run/user/1000/tca")
        text = text.replace(f"{self.folder}", "/home/you/robot")
        text = re.sub(rf"\b{os.uname().nodename}:(?=\d)", "laptop:", text)
        step.quoted.write_text(text)
