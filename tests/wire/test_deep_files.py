"""A deeply nested file raises the same error as any other wrong file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tca_behaviours.activities.models.reading import read_model
from tca_central.shell.permissions_file import PermissionsError, read_rules
from tca_tools.errors import BadUserFile
from tca_tools.supervise.robot_file import load
from tca_wire.errors import KeyRefused
from tca_wire.keys import read_client_key


@pytest.mark.parametrize(
    ("read", "error"),
    [
        (read_rules, PermissionsError),
        (load, BadUserFile),
        (read_model, BadUserFile),
        (read_client_key, KeyRefused),
    ],
)
def test_deeply_nested_file_is_refused(
    tmp_path: Path, read: Callable[[Path], Any], error: type[Exception]
) -> None:
    path = tmp_path / "file.toml"
    path.touch(0o600)
    path.write_text(f"key = {'[' * 5000}")
    with pytest.raises(error, match="recursion"):
        read(path)
