"""The wheel and the source distribution, made by ``python -m build``, work in a fresh virtual
environment.

The dependencies come from the environment of the tests, so nothing is downloaded.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
from pathlib import Path

import pytest
import sampling
from docs.examples import EXAMPLES, agrees
from docs.pages import PROGRAMS, Block, blocks
from processes import central

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(path.parent.name for path in ROOT.glob("tca_*/__init__.py"))

EVERY_MODULE = f"""
import importlib, pathlib
for package in {PACKAGES}:
    folder = pathlib.Path(importlib.import_module(package).__file__).parent
    assert "fresh" in folder.parts, folder
    assert (folder / "py.typed").exists(), folder
    for path in sorted(folder.rglob("*.py")):
        if path.stem != "__main__" and path.parent.name != "peers":  # optional tools
            importlib.import_module(".".join([package, *path.relative_to(folder).with_suffix("").parts]))
            print(path.relative_to(folder.parent))
"""


def run(*command: object, cwd: Path, **environment: str) -> str:
    result = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        | environment,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the wheel, and return its folder. In the soak, it is made of the sources in the source
    distribution.
    """
    sources = tmp_path_factory.mktemp("sources")
    for name in ("setup.cfg", "setup.py", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources)
    for name in PACKAGES:
        shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
    kinds = [] if sampling.in_the_soak else ["--wheel"]
    run(sys.executable, "-m", "build", "--no-isolation", *kinds, sources, cwd=sources)
    return sources / "dist"


@pytest.fixture(scope="module")
def python(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the interpreter of an environment into which the wheel was installed."""
    environment = tmp_path_factory.mktemp("environment") / "fresh"
    run(sys.executable, "-m", "venv", "--without-pip", environment, cwd=dist)
    python = environment / "bin" / "python"
    pip = (
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        "--no-compile",
    )
    run(*pip, *dist.glob("*.whl"), cwd=dist)
    packages = Path(
        run(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=dist
        ).strip()
    )
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def files(package: str) -> set[str]:
    """Return the files of a package in this checkout."""
    return {
        str(path.relative_to(ROOT))
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")
    }


@pytest.mark.soak
@pytest.mark.slow
def test_source_distribution_contains_all_sources(dist: Path) -> None:
    if not sampling.in_the_soak:
        run(sys.executable, "-m", "build", "--no-isolation", "--sdist", dist.parent, cwd=dist)
    (archive,) = dist.glob("tca_central-*.tar.gz")
    with tarfile.open(archive) as opened:
        names = {name.partition("/")[2] for name in opened.getnames()}
    assert set().union(*map(files, PACKAGES)) <= names


@pytest.mark.slow
def test_installed_wheel_contains_every_file(python: Path) -> None:
    source_files = {name for package in PACKAGES for name in files(package)}
    installed = python.parents[1] / sysconfig.get_path("purelib", vars={"base": ""}).lstrip("/")
    assert [name for name in source_files if not (installed / name).exists()] == []


@pytest.mark.soak
@pytest.mark.slow
def test_each_module_of_the_wheel_can_be_imported(python: Path, tmp_path: Path) -> None:
    imported = set(run(python, "-c", EVERY_MODULE, cwd=tmp_path).split())
    source_files = {name for package in PACKAGES for name in files(package)}
    unwanted = ("__main__.py", *(name for name in source_files if "/peers/" in name))
    assert imported == {
        name for name in source_files if name.endswith(".py") and not name.endswith(unwanted)
    }


@pytest.mark.slow
def test_readme_program_works_with_the_installed_wheel(python: Path, tmp_path: Path) -> None:
    """``pip install .`` builds the wheel that is installed here. Program, output and tree are those
    that the README prints.
    """
    tca = python.with_name("tca")
    assert run(tca, "--version", cwd=tmp_path).startswith("tca, version ")
    install, program, console = [block.text for block in blocks(ROOT / "README.md")]
    printed, tree = console.removeprefix("$ python deliver.py\n").split("$ tca tree\n")
    assert install.splitlines()[-1] == "$ tca central"
    assert program.splitlines()[-1].count(".result()") == 1
    with central(tmp_path, command=(str(tca), "central")) as daemon:
        output = run(python, "-c", program, cwd=tmp_path, TCA_CENTRAL=daemon.address)
    assert output == printed
    assert rows_of(run(tca, "tree", daemon.journal, cwd=tmp_path)) == rows_of(tree)


@pytest.mark.soak
@pytest.mark.slow
def test_readme_installs_as_printed(tmp_path: Path) -> None:
    """Run the lines in a copy of the checkout."""
    for name in run("git", "ls-files", cwd=ROOT).split():
        if (ROOT / name).is_file():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / name)
    first, second, _ = next(blocks(ROOT / "README.md")).text.replace("$ ", "").splitlines()
    assert " central " in run("sh", "-ec", f"{first}\n{second}\ntca --help", cwd=tmp_path)


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_runs_with_the_installed_wheel(path: Path, python: Path, tmp_path: Path) -> None:
    with central(tmp_path) as daemon:
        output = run(python, path, cwd=tmp_path, TCA_CENTRAL=daemon.address)
    assert agrees(path.stem, output), output


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("block", PROGRAMS, ids=[block.where for block in PROGRAMS])
def test_page_program_runs_with_the_installed_wheel(
    block: Block, python: Path, tmp_path: Path
) -> None:
    with central(tmp_path) as daemon:
        run(python, "-c", block.text, cwd=tmp_path, TCA_CENTRAL=daemon.address)


def rows_of(tree: str) -> list[str]:
    """Return each task of a drawn tree with its state. Times and column widths are left out,
    because they vary.
    """
    return re.findall(r"^.*\{\d+\} +\w+", tree, re.MULTILINE)
