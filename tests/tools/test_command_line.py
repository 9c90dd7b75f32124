import sys
from collections.abc import Callable
from configparser import ConfigParser
from importlib import import_module
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import Result
from tools.story import walking

from tca_tools import command_line
from tca_tools.errors import ToolError
from tca_wire.text.missing import missing_package

Tca = Callable[..., Result]


@click.command()
@click.argument("how", default="well")
def hello(how: str) -> None:
    """Say hello.

    At length.
    """
    if how == "badly":
        raise ToolError("hello: nobody is here: come again")
    if not how.islower():
        raise click.UsageError(f"{how}: this is no way")
    click.echo(how)


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install three commands. Two of them cannot be imported."""
    found = [
        EntryPoint("hello", f"{__name__}:hello", command_line.COMMANDS),
        EntryPoint("lost", "no_such_package.commands:lost", command_line.COMMANDS),
        EntryPoint("trap", "tools.no_such_trap:trap", command_line.COMMANDS),
    ]

    def entry_points(**wanted: Any) -> EntryPoints:
        return EntryPoints(found).select(**wanted)

    monkeypatch.setattr(command_line, "entry_points", entry_points)


def test_help_lists_every_command_with_one_line(tca: Tca) -> None:
    lines = tca("--help").stdout.splitlines()
    assert "  hello       Say hello." in lines
    assert "  lost        (can't be loaded)" in lines
    assert "  completion  Print the shell code that completes 'tca' commands." in lines


def test_command_runs_without_importing_the_others(
    tca: Tca, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []
    load = command_line._load

    def noted(found: EntryPoint) -> click.Command:
        loaded.append(found.name)
        return load(found)

    monkeypatch.setattr(command_line, "_load", noted)
    assert tca("hello").stdout == "well\n"
    assert set(loaded) == {"hello"}


def test_unknown_command_suggests_the_nearest(tca: Tca) -> None:
    result = tca("helo")
    assert result.exit_code == 2
    assert result.stderr.endswith("Error: no command 'helo': did you mean 'hello'?\n")
    assert tca("xyzzy").exit_code == 2


def test_command_that_cannot_be_imported_names_the_reason(tca: Tca) -> None:
    result = tca("lost", "--anything", "goes")
    assert result.exit_code == 1
    assert result.stderr.startswith(
        "Error: command 'lost' can't be loaded (No module named 'no_such_package')"
    )


def test_tool_error_prints_one_line_and_exits_1(tca: Tca) -> None:
    refused = tca("hello", "badly")
    assert (refused.exit_code, refused.stderr) == (1, "Error: hello: nobody is here: come again\n")


def test_wrong_usage_points_to_help(tca: Tca) -> None:
    for arguments in (["--loudly"], ["README"], ["a", "b"]):
        wrong = tca("hello", *arguments)
        assert wrong.exit_code == 2
        assert "tca hello --help" in wrong.stderr
    assert tca("--nothing").exit_code == 2
    assert tca().stderr.startswith("Usage: tca")


def test_version_and_completion_are_printed(tca: Tca) -> None:
    assert tca("--version").stdout.startswith("tca, version ")
    for shell in ("bash", "zsh", "fish"):
        assert "_TCA_COMPLETE" in tca("completion", shell).stdout


def test_call_from_python_raises_usage_error() -> None:
    with pytest.raises(click.UsageError):
        command_line.main.main(["helo"], standalone_mode=False)
    assert command_line.main.main(["hello"], standalone_mode=False) is None


def test_tools_run_as_modules(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import runpy

    monkeypatch.setattr(sys, "argv", ["gantt", str(walking().write(tmp_path / "run"))])
    monkeypatch.delitem(sys.modules, "tca_tools.gantt.__main__", raising=False)
    # pytest's hook for the package of its plugin has no code to run
    finders = [one for one in sys.meta_path if type(one).__name__ != "AssertionRewritingHook"]
    monkeypatch.setattr(sys, "meta_path", finders)
    with pytest.raises(SystemExit) as end:
        runpy.run_module("tca_tools.gantt.__main__", run_name="__main__")
    assert end.value.code == 0
    assert capsys.readouterr().out.startswith("run: ")


def test_installed_command_has_its_entry_point_name_and_group() -> None:
    config = ConfigParser()
    config.read(Path(__file__).parents[2] / "setup.cfg")
    lines = config["options.entry_points"]["tca.commands"].strip().splitlines()
    for name, target in (line.split(" = ") for line in lines):
        module, _, attribute = target.partition(":")
        assert getattr(import_module(module), attribute).name == name
        assert any(name in group for group in command_line.GROUPS.values()), (
            f"'{name}' is listed under 'More'"
        )


def test_missing_package_text_has_one_source() -> None:
    root = Path(command_line.__file__).parents[1]
    sources = [
        file.name
        for folder in ("tca_tools", "tca_tools.live", "tca_wire", "tca_module", "tca_tools.explore")
        for file in (root / folder).rglob("*.py")
        if "pip install" in file.read_text()
    ]
    assert sources == ["missing.py"]
    assert missing_package("a .png", "rich", "top", "ask for .svg") == (
        "a .png needs the Python package 'rich': pip install 'tca-central[top]', or ask for .svg"
    )
