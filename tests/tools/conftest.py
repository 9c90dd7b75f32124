"""Fixtures: a command line to run, and expected texts in files."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from tools.story import stumbling

from tca_tools.command_line import main

TRANSCRIPTS = Path(__file__).parent / "transcripts"


@pytest.fixture
def tca(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Return a function that runs ``tca`` with arguments. Its result has exit_code, stdout and
    stderr.
    """
    monkeypatch.delenv("COLUMNS", raising=False)

    def run(*arguments: object, **environment: str) -> Result:
        return CliRunner(env=environment).invoke(
            main, [str(argument) for argument in arguments], prog_name="tca"
        )

    return run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Write the journal of the walk that ends with a failure. Return its folder."""
    return stumbling().write(tmp_path / "run")


@pytest.fixture
def expect(rewrite: bool) -> Callable[[str, str], None]:
    """Return a function that compares a text with the file of a name. ``--rewrite`` replaces the
    file.
    """

    def compare(name: str, text: str) -> None:
        path = TRANSCRIPTS / f"{name}.txt"
        if rewrite:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        assert text == path.read_text()

    return compare
