"""The README's commands and its program do what is printed below them."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from docs.pages import ROOT, blocks

pytestmark = pytest.mark.slow
BLOCKS = list(blocks(ROOT / "README.md"))
INSTALL, CENTRAL = BLOCKS[0].text.replace("$ ", "").rsplit("\n", 2)[:2]
(PROGRAM,) = [block for block in BLOCKS if block.language == "python"]
PRINTED, TREE = (block for block in BLOCKS if block.language == "text")


@pytest.fixture
def environment(tmp_path: Path) -> Mapping[str, str]:
    """Return a home of its own, in which the commands of this installation are found."""
    paths = [str(Path(sys.executable).parent), os.environ["PATH"]]
    return os.environ | {
        "HOME": str(tmp_path),
        "XDG_STATE_HOME": str(tmp_path / "state"),
        "TCA_CENTRAL": f"ipc://{tmp_path}/central.sock",
        "PATH": os.pathsep.join(paths),
    }


@pytest.fixture
def central(environment: Mapping[str, str], tmp_path: Path) -> Iterator[None]:
    """Run central with the README's command."""
    with subprocess.Popen(
        CENTRAL.split(), cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    ) as daemon:
        assert daemon.stderr is not None
        assert "listening" in daemon.stderr.readline()
        yield
        daemon.terminate()
        daemon.communicate(timeout=60)


def printed_by(command: list[str], environment: Mapping[str, str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def without_times(text: str) -> str:
    """Replace the name of the run, and all times."""
    return re.sub(r"\d+\.\d\d", "#", re.sub(r"^0000\S+:", "RUN:", text))


@pytest.mark.usefixtures("central")
def test_readme_prints_what_it_says(environment: Mapping[str, str], tmp_path: Path) -> None:
    (tmp_path / "deliver.py").write_text(PROGRAM.text)
    assert printed_by(["python", "deliver.py"], environment, tmp_path) == PRINTED.text
    tree = printed_by(["tca", "tree"], environment, tmp_path)
    assert without_times(tree) == without_times(TREE.text)


@pytest.mark.soak
def test_readme_installs_as_printed(tmp_path: Path) -> None:
    """Run the lines in a copy of the checkout, with an empty home."""
    names = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    for name in names:
        if (ROOT / name).is_file():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / name)
    script = f"set -e\n{INSTALL}\ntca --help\npip uninstall --yes tca-central\n"
    done = subprocess.run(
        ["sh", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert " central " in done.stdout


def test_readme_ends_its_program_with_a_result() -> None:
    assert ".result()" in PROGRAM.text.splitlines()[-1]
