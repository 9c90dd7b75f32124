"""The mistakes in ``mistakes.py`` are found by mypy, and nothing else there is called one.

In strict mode mypy complains of each ``type: ignore`` that is not needed: so each mistake is found.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MYPY = shutil.which("mypy", path=str(Path(sys.executable).parent))


@pytest.mark.slow
@pytest.mark.skipif(MYPY is None, reason="mypy is not installed")
def test_the_type_checker_finds_each_mistake() -> None:
    options = ["--config-file", "setup.cfg", "--follow-imports", "silent", "--cache-dir", os.devnull]
    command = [sys.executable, "-m", "mypy", *options, str(Path(__file__).with_name("mistakes.py"))]
    found = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
