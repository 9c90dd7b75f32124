"""A user's file runs as under python, so it can import modules beside it."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tca_tools.errors import BadUserFile
from tca_tools.user_file import names_of


@pytest.fixture(autouse=True)
def _python_as_it_was() -> Iterator[None]:
    path, modules = list(sys.path), set(sys.modules)
    yield
    sys.path[:] = path
    for name in sys.modules.keys() - modules:
        del sys.modules[name]


def write(folder: Path, **files: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    return folder / "scenario.py"


def test_user_file_imports_modules_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The imports work from any working directory, through a link, and in a function that is called
    later.
    """
    text = "from legs import LEGS\ndef later():\n    import arms\n    return arms.ARMS"
    path = write(tmp_path / "robot", scenario=text, legs="LEGS = 6", arms="ARMS = 2")
    (tmp_path / "link.py").symlink_to(path)
    monkeypatch.chdir(tmp_path)
    for one in (path, Path("robot/scenario.py"), Path("link.py")):
        names = names_of(one)
        assert (names["LEGS"], names["later"]()) == (6, 2)


def test_modules_beside_an_earlier_user_file_are_not_reused(tmp_path: Path) -> None:
    """Each of two robots has its own messages.py, and both are checked in one process."""
    for robot, legs in (("ambler", 6), ("dog", 4), ("ambler", 6)):
        path = write(
            tmp_path / robot, scenario="from messages import LEGS", messages=f"LEGS = {legs}"
        )
        (tmp_path / robot / "parts").mkdir(exist_ok=True)
        (tmp_path / robot / "parts" / "head.py").write_text(f"EYES = {legs}")
        path.write_text("from messages import LEGS\nfrom parts.head import EYES")
        names = names_of(path)
        assert (names["LEGS"], names["EYES"]) == (legs, legs)
    assert str((tmp_path / "dog").resolve()) not in sys.path


def test_shared_modules_are_imported_once(tmp_path: Path) -> None:
    names_of(write(tmp_path / "one", scenario="import tca_wire.vocabulary"))
    known = sys.modules["tca_wire.vocabulary"], os.path
    names_of(write(tmp_path / "two", scenario=""))
    assert (sys.modules["tca_wire.vocabulary"], os.path) == known


def test_error_in_a_user_file_names_its_line(tmp_path: Path) -> None:
    path = write(tmp_path, scenario="\nimport messages", messages="1 / 0")
    with pytest.raises(
        BadUserFile, match=r"scenario.py, line 2: can't be run: ZeroDivisionError: division by zero"
    ):
        names_of(path)
