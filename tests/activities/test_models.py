"""A model is checked, drawn and turned into working Python; handwritten code is kept."""

import os
import re
import subprocess
import sys
from ast import literal_eval
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from tca_behaviours.activities.models.command import generate
from tca_behaviours.activities.models.dot import model_dot
from tca_behaviours.activities.models.reading import read_model
from tca_tools.errors import BadUserFile

HERE = Path(__file__).parent
MODEL = HERE / "cleaning.toml"
TEXT = MODEL.read_text()


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Return a copy of the model in its own folder."""
    path = tmp_path / "robot" / "cleaning.toml"
    path.parent.mkdir()
    path.write_text(TEXT)
    return path


def run_generate(*arguments: object) -> Result:
    return CliRunner().invoke(generate, list(map(str, arguments)))


def python(folder: Path, *code: str) -> str:
    done = subprocess.run(
        [sys.executable, *code],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(HERE.parent.parent)},
        timeout=60,
    )
    assert not done.returncode, done.stderr
    return done.stdout


def test_transition_after_a_time_is_generated(model: Path) -> None:
    row = '{ from = "searching", to = "referenced", on = "switch" }'
    assert row in TEXT
    model.write_text(TEXT.replace(row, row.replace('on = "switch"', "after = 2.5")))
    assert not run_generate(model).exit_code
    code = (model.parent / "generated.py").read_text()
    assert 'states["searching"].after(2.5, states["referenced"])' in code


# --- bad models -----------------------------------------------------------------------------------


def test_invalid_model_is_rejected_with_its_line(
    tmp_path: Path, approve: Callable[..., None]
) -> None:
    """Each case replaces a part of the valid model: OLD -> NEW. " / " stands for a line break."""
    path = tmp_path / "cleaning.toml"

    def message_of(case: str) -> str:
        old, _, new = case.replace(" / ", "\\n").rpartition(" -> ")
        assert old.replace("\\n", "\n") in TEXT, case
        path.write_text(TEXT.replace(old.replace("\\n", "\n") or TEXT, literal_eval(new), 1))
        with pytest.raises(BadUserFile) as error:
            read_model(path)
        return str(error.value).replace(f"{tmp_path}/", "")

    approve("bad_models.txt", message_of)


def test_generate_reports_a_missing_model_in_one_line(tmp_path: Path) -> None:
    shown = run_generate(tmp_path / "no.toml")
    assert (shown.exit_code, shown.output) == (
        2,
        f"Error: {tmp_path}/no.toml can't be read: No such file or directory\n",
    )


def test_model_of_the_examples_is_valid() -> None:
    model = read_model(HERE.parent.parent / "examples/joint.toml")
    assert list(model.instances) == ["x", "y", "panel"]


# --- code -----------------------------------------------------------------------------------------

TRY = """
from tca_behaviours.activities import Application, VirtualBaton
from application import Components
components, baton = Components(), VirtualBaton()
robot = Application("robot", components.all, baton=baton)
robot.initialise()
components.panel.all_joints.set("enable")
robot.start()
baton.run(1.0)
print(components.x.movement.path, sum(one.ticks for one in robot.figures().activities) > 100)
with components.y.exclusion:
    print(components.y.data)
"""
CTRL_C = """
import os, signal, application
def show(change):
    print(change)
    if change.component == "y" and change.region == "movement":
        os.kill(os.getpid(), signal.SIGINT)
application.print = show
signal.signal(signal.SIGINT, signal.default_int_handler)
application.main()
"""


def test_generated_code_runs_at_once(model: Path) -> None:
    assert run_generate(model).output.splitlines() == [
        f"{model.parent}/{name}: written"
        for name in ("generated.py", "application.py", "joint.py", "panel.py")
    ]
    assert python(model.parent, "-c", TRY).splitlines() == [
        "('stopped',) True",
        "JointData(position=0.0, length=2.0, mode='off', steps=0, on=False)",
    ]
    assert python(model.parent, "-c", CTRL_C).splitlines()[:2] == [
        "x.limits: start to inside",
        "x.referencing: start to unreferenced",
    ]


def test_generate_keeps_handwritten_code(model: Path) -> None:
    run_generate(model)
    by_hand = model.parent / "joint.py"
    by_hand.write_text(
        by_hand.read_text().replace(
            "def take_command(self, value: str) -> None:",
            "def take_command(self, value: str) -> None:\n        self.post(value)\n\n    def mine(self) -> None:",
        )
    )
    before = {file: file.read_bytes() for file in model.parent.glob("*.py")}
    assert [line.partition(": ")[2] for line in run_generate(model).output.splitlines()] == [
        "unchanged"
    ] * 2 + ["yours, not changed"] * 2
    assert {file: file.read_bytes() for file in model.parent.glob("*.py")} == before

    model.write_text(
        TEXT.replace('{ name = "enabled" }', '{ name = "enabled", entry = "brake_off" }').replace(
            '"is_near"', '"is_close"'
        )
    )
    output = run_generate(model).output
    assert f"{by_hand}: yours, not changed; class Joint lacks brake_off, is_close. Add:" in output
    assert by_hand.read_bytes() == before[by_hand]
    (added,) = output.split("Add:\n")[1].split(f"{model.parent}/panel.py")[:1]
    by_hand.write_text(by_hand.read_text() + added)
    assert python(model.parent, "-c", TRY)


def test_generate_does_not_overwrite_foreign_files(model: Path) -> None:
    other = model.parent / "generated.py"
    other.write_text("mine = 1\n")
    shown = run_generate(model)
    assert (shown.exit_code, shown.output.partition(": ")[2]) == (
        2,
        f"{other} exists already, and was not made by tca generate: rename it, or choose a folder with -o FOLDER\n",
    )
    assert sorted(file.name for file in model.parent.iterdir()) == ["cleaning.toml", "generated.py"]
    folder = model.parent / "code"
    assert not run_generate(model, "-o", folder).exit_code
    (folder / "joint.py").write_text("class Joint(:\n")
    assert (
        run_generate(model, "-o", folder).output
        == f"Error: {folder}/joint.py, line 1: can't be read: invalid syntax\n"
    )
    (folder / "joint.py").write_text("class Elbow: ...\n")
    assert (
        "joint.py: yours, not changed; it lacks class Joint: add it"
        in run_generate(model, "-o", folder).output
    )


def test_generated_package_imports_its_own_name(model: Path) -> None:
    inner = model.parent / "inner"
    inner.mkdir()
    for package in (model.parent, inner):
        (package / "__init__.py").touch()
    run_generate(model, "-o", inner)
    assert "from robot.inner.generated import JointBase, Target" in (inner / "joint.py").read_text()
    python(model.parent.parent, "-c", TRY.replace("from app", "from robot.inner.app"))


def test_generated_code_imports_types_of_a_module(model: Path) -> None:
    fields = '[types.Target]\nposition = "float"\nspeed = "float"'
    model.write_text(TEXT.replace(fields, '[types]\nTarget = "messages:Target"'))
    (model.parent / "messages.py").write_text("class Target: ...\n")
    run_generate(model)
    assert "\nfrom messages import Target\n" in (model.parent / "joint.py").read_text()
    python(model.parent, "-c", "import joint")


def test_generated_code_passes_formatter_and_linter(model: Path) -> None:
    run_generate(model)
    ruff = Path(sys.executable).parent / "ruff"
    for length in (88, 120):
        options = ["--isolated", f"--config=line-length={length}"]
        done = subprocess.run(
            [ruff, "format", "--check", *options, model.parent], capture_output=True, check=False
        )
        assert not done.returncode, done.stderr
    checked = subprocess.run(
        [
            ruff,
            "check",
            "--config",
            HERE.parent.parent / "pyproject.toml",
            "--ignore=INP001",
            model.parent,
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert not checked.returncode, checked.stdout


@pytest.mark.soak
def test_generated_code_passes_mypy(model: Path) -> None:
    run_generate(model)
    python(model.parent, "-m", "mypy", "--strict", ".")


# --- pictures -------------------------------------------------------------------------------------


def test_each_transition_has_its_own_arrow(model: Path) -> None:
    """Two states may have two transitions, one for a stop and one for a loss of power. One arrow
    for both would suggest that both are needed.
    """
    labels = re.findall(r"label=<([^>]*)>, dir=back", model_dot(read_model(model)))
    assert [label for label in labels if "able" in label or "stop" in label] == [
        "&#160;disable&#160;",
        "&#160;stop&#160;",
        "&#160;disable&#160;",
    ]


def test_generate_draws_a_model(model: Path) -> None:
    picture = model.with_suffix(".svg")
    assert not run_generate(model, "-o", picture).exit_code
    shown = picture.read_text()
    words = [
        "Joint",
        "movement",
        "moving",
        "move_fast every 10 ms",
        "in: command (str), keeps 8",
        "[is_near]",
        "length = 2.0",
    ]
    assert [word for word in words if word not in shown] == []
    refused = run_generate(model, "-o", model.with_suffix(".jpg"))
    assert refused.exit_code == 2
    assert "give a picture (.svg, .png, .pdf, .dot), or a folder without a suffix" in refused.output
