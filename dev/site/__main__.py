"""Build the site of the documents in build/site.

Broken links, missing anchors and files, and docstrings that do not match their functions fail the
build. Decisions are records: they are pages without navigation, and the search does not find them.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

from dev.site.parts import write_parts
from dev.site.root import ROOT, SITE

STOPPED = re.compile(r"^\S*Error: .+$", re.MULTILINE)
"""The last line of a traceback: a quoted file is missing, for example."""
RECORDS = "decisions/"
COLOUR = re.compile(r"\x1b\[[\d;]*m")
WRONG = re.compile(r"(?:Warning|Error): (.+)\n.*\[ (\S+:\d+)", re.IGNORECASE)
DOCSTRING = re.compile(r"griffe: .+")
"""What Zensical and its reader of docstrings print of something wrong."""


def build() -> str:
    """Build the site, and return what was printed if something is wrong."""
    write_parts()
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--clean", "--strict"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    printed = COLOUR.sub("", done.stdout + done.stderr)
    wrong = [f"{place}: {what}" for what, place in WRONG.findall(printed)]
    wrong += DOCSTRING.findall(printed)
    wrong += STOPPED.findall(printed)[-1:]
    if done.returncode and not wrong:
        return printed
    if not wrong:
        leave_out_records()
        wrong = [
            f"{page.name} loads {url}" for page in SITE.rglob("*.html") for url in loaded(page)
        ]
    return "\n".join(wrong)


def loaded(page: Path) -> list[str]:
    """Return what a page of the site loads from other servers. The site works offline."""
    return re.findall(r'<(?:script|link|img)[^>]* (?:src|href)="(https?:[^"]+)"', page.read_text())


def leave_out_records() -> None:
    """Remove the records from the index of the search."""
    index = json.loads((SITE / "search.json").read_text())
    index["items"] = [one for one in index["items"] if not one["location"].startswith(RECORDS)]
    text = json.dumps(index, separators=(",", ":"))
    (SITE / "search.json").write_text(text)
    (SITE / "search.js").write_text(f"var __index = {text}")


def main() -> int:
    """Build the site, and say where it is."""
    if wrong := build():
        print(wrong, file=sys.stderr)
        return 1
    print(f"{(SITE / 'index.html').relative_to(ROOT)}: open it in a browser")
    return 0


if __name__ == "__main__":
    sys.exit(main())
