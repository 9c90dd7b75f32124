"""Every example runs, is short, and prints the expected lines."""

import re
from pathlib import Path

import pytest
from module.real_central import RealCentral
from processes import run

pytestmark = pytest.mark.slow
EXAMPLES = Path(__file__).parents[2] / "examples"

_TEXT = Path(__file__).with_name("printed.txt").read_text()
PRINTED = {name: text for name, _, text in (one.partition("\n") for one in _TEXT.split("== ")[1:])}
"""The start of each example's output. Each text after ``...`` occurs somewhere in the output."""


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_prints_the_expected_lines(path: Path, tmp_path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 70
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        done = run(str(path), TCA_CENTRAL=daemon.address)
    assert done.returncode == 0, done.stderr
    printed = done.stdout
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


def test_each_example_is_mentioned_in_the_docs() -> None:
    pages = [EXAMPLES.parent / "README.md", *(EXAMPLES.parent / "docs").glob("*.md")]
    shown = {
        number
        for page in pages
        for number in re.findall(r"(?:Example |examples/)(\d\d)", page.read_text())
    }
    assert shown == {path.name[:2] for path in EXAMPLES.glob("*.py")}


def test_readme_quotes_the_first_example() -> None:
    code = (EXAMPLES / "01_fetch.py").read_text().partition('"""\n\n')[2]
    readme = (EXAMPLES.parent / "README.md").read_text()
    assert readme.partition("```python\n")[2].partition("```")[0] == code
    assert readme.partition(code)[2].split("```\n")[2] == PRINTED["01_fetch"]
