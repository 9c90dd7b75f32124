"""The picture of the tutorial: the page of ``tca view`` while the tutorial's robot works.

Central and the programs of page 5 run in a temporary folder, and Chromium opens the page.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parents[2]
SIZE = {"width": 1280, "height": 740}
PAGES = ("3-order", "4-failure", "5-watch")
"""The folders whose files lie over each other; the body is the one of page 4, as on page 5."""
PYTHON = sys.executable
TCA = str(Path(PYTHON).with_name("tca"))


@contextmanager
def program(*command: str, folder: Path) -> Iterator["subprocess.Popen[str]"]:
    """Run a program until the end of the block."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "XDG_RUNTIME_DIR": str(folder),
        "XDG_STATE_HOME": str(folder / "state"),
    }
    environment.pop("TCA_CENTRAL", None)
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as running:
        try:
            yield running
        finally:
            running.send_signal(signal.SIGINT)


def save_files(folder: Path) -> None:
    """Save the files as they are on page 5, before the body is replaced."""
    for page in PAGES:
        for file in (ROOT / "examples" / "tutorial" / page).glob("*.py"):
            shutil.copy(file, folder)
    shutil.copy(ROOT / "examples" / "tutorial" / "4-failure" / "body.py", folder)


def take_picture(address: str, file: Path) -> None:
    """Open the page, and take its picture soon after the detour."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
        page.goto(address)
        page.get_by_text("take detour").first.wait_for(timeout=60_000)
        time.sleep(0.6)  # the second try
        page.screenshot(path=file)
        browser.close()


def tutorial(file: Path) -> None:
    """Run the robot, and write the picture into *file*."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        save_files(folder)
        stack.enter_context(program(TCA, "central", folder=folder))
        time.sleep(1)
        for one in ("planner.py", "recovery.py", "body.py"):
            stack.enter_context(program(PYTHON, one, folder=folder))
        time.sleep(3)
        stack.enter_context(program(PYTHON, "user.py", folder=folder))
        viewer = stack.enter_context(program(TCA, "view", "--no-browser", folder=folder))
        assert viewer.stdout is not None
        _, _, address = viewer.stdout.readline().partition(": ")
        take_picture(address.split()[0], file)
