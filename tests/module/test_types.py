"""The mistakes in ``mistakes.py`` are found by mypy, nothing else there is called one, and its words help.

In strict mode mypy complains of each ``type: ignore`` that is not needed: so each mistake is found.
"""

import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import tca_module
from tca_module import HandlerOptions, MonitorOptions, TaskOptions
from tca_wire.messages.declaring import Declaring

MYPY = shutil.which("mypy", path=str(Path(sys.executable).parent))


@pytest.mark.slow
@pytest.mark.skipif(MYPY is None, reason="mypy is not installed")
def test_the_type_checker_finds_each_mistake_and_says_what_is_wanted(tmp_path: Path) -> None:
    mistakes = Path(__file__).with_name("mistakes.py")
    bare = tmp_path / "bare.py"
    bare.write_text(re.sub(r"  # type: ignore\S+", "", mistakes.read_text()))
    options = ["--config-file", "setup.cfg", "--follow-imports", "silent", "--cache-dir", os.devnull]
    command = [sys.executable, "-m", "mypy", *options, str(mistakes), str(bare)]
    found = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert str(mistakes.name) not in found.stdout, found.stdout
    expected = re.findall(r'of "HandlerDecorator\w*" has .*; expected (.*)  \[', found.stdout)
    assert len(expected) == mistakes.read_text().count("handles(STANCE)  # type") + 1
    assert not [text for text in expected if "Coroutine" in text]
    assert 'incompatible type "Command[int, Footfall]"; expected "Command[None, Footfall]"' in found.stdout
    assert 'Missing positional argument "data"' in found.stdout


DECLARATIONS = [one for name in tca_module.__all__ if isinstance(one := getattr(tca_module, name), Declaring)]


@pytest.mark.parametrize("kind", DECLARATIONS, ids=lambda kind: kind.__name__)
def test_a_declaration_shows_its_arguments(kind: Any) -> None:
    arguments = inspect.signature(kind).parameters
    assert list(arguments)[:2] == ["name", "data"]
    assert not {"VAR_POSITIONAL", "VAR_KEYWORD"} & {one.kind.name for one in arguments.values()}


@pytest.mark.parametrize("kind", [HandlerOptions, MonitorOptions, TaskOptions], ids=lambda kind: kind.__name__)
def test_help_shows_each_option(kind: Any) -> None:
    _, _, described = kind.__doc__.partition("Args:")
    assert [name for name in kind.__annotations__ if not re.search(rf"\b{name}[:,]", described)] == []
