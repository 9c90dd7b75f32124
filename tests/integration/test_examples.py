"""Every example runs, is short, and prints what it says."""

import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import RealCentral

pytestmark = pytest.mark.slow
EXAMPLES = Path(__file__).parents[2] / "examples"

_TEXT = Path(__file__).with_name("printed.txt").read_text()
PRINTED = {name: text for name, _, text in (one.partition("\n") for one in _TEXT.split("== ")[1:])}
"""What each begins with; after the first ``...``, what is in it as well."""


RUNNER = """
import gc, os, runpy, sys
import tca_tools.explore, tca_module.testing
gc.freeze()  # a child's collections copy no memory
for line in sys.stdin:
    path, address, output = line.split()
    if not (child := os.fork()):
        os.environ["TCA_CENTRAL"] = address
        for stream in (1, 2):
            os.dup2(os.open(f"{output}.{stream}", os.O_WRONLY | os.O_CREAT), stream)
        sys.path[0] = os.path.dirname(path)
        runpy.run_path(path, run_name="__main__")
        sys.exit()
    print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.fixture(scope="module")
def runner() -> Iterator["subprocess.Popen[str]"]:
    """Runs a program at a central, each time in a new process that has imported the libraries already."""
    command, environment = [sys.executable, "-c", RUNNER], {**os.environ, "PYTHONPATH": str(EXAMPLES.parent)}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1, env=environment
    ) as running:  # fmt: skip
        yield running


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example(path: Path, tmp_path: Path, runner: "subprocess.Popen[str]") -> None:
    assert len(path.read_text().splitlines()) <= 70
    assert runner.stdin
    assert runner.stdout
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        runner.stdin.write(f"{path} {daemon.address} {tmp_path}/said\n")
        too_late = threading.Timer(60, runner.kill)
        too_late.start()
        code = runner.stdout.readline()
        too_late.cancel()
    printed = (tmp_path / "said.1").read_text()
    assert code == "0\n", (tmp_path / "said.2").read_text()
    first, *later = PRINTED[path.stem].split("...")
    assert printed.startswith(first)
    assert not [words for words in later if words.strip() not in printed]
    if path.stem == "03_plan_ahead":
        diary = printed.splitlines()
        assert [line for line in diary if "plan" in line] == [f"plan row {row}" for row in range(4)]
        assert [line for line in diary if "mow" in line] == [f"mow row {row}" for row in range(4)]
        for row in range(3):
            assert diary.index(f"plan row {row + 1}") < diary.index(f"mow row {row}")
        for row in range(2):
            assert diary.index(f"mow row {row}") < diary.index(f"plan row {row + 2}")


def test_each_example_is_shown_in_the_docs() -> None:
    pages = [EXAMPLES.parent / "README.md", *(EXAMPLES.parent / "docs").glob("*.md")]
    shown = {number for page in pages for number in re.findall(r"(?:Example |examples/)(\d\d)", page.read_text())}
    assert shown == {path.name[:2] for path in EXAMPLES.glob("*.py")}


def test_the_readme_quotes_the_first_example() -> None:
    code = (EXAMPLES / "01_fetch.py").read_text().partition('"""\n\n')[2]
    readme = (EXAMPLES.parent / "README.md").read_text()
    assert readme.partition("```python\n")[2].partition("```")[0] == code
    assert readme.partition(code)[2].split("```\n")[2] == PRINTED["01_fetch"]
