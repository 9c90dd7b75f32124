"""The plugin for pytest, as users have it: pytest loads it by its entry point, in a process of its
own. The example of a robot with tests is run in the same way.
"""

import configparser
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tca_tools.journal.journals import open_log
from tca_wire.journal.facts import Received

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]

USERS_TESTS = """
import os
import pytest
from tca_module import Command, Outcome, connect

LIFT = Command("lift", float, result=float)


def lift_on(central, kg):
    lift = central.fake(LIFT, returns=2 * kg)
    with connect("test", central.address if os.environ.get("TCA_CENTRAL") else central) as user:
        assert user.command(LIFT, kg).result(timeout=60) == 2 * kg
    assert lift.calls == [kg]


def test_stepped(tca_central):
    assert tca_central.is_stepped
    lift_on(tca_central, 1.0)


@pytest.mark.tca_real_clock
def test_real_clock(tca_central):
    assert not tca_central.is_stepped
    lift_on(tca_central, 2.0)


def test_failing_stepped(tca_central):
    lift_on(tca_central, 3.0)
    assert False


@pytest.mark.parametrize("kg", [4.0, 5.0])
def test_daemon(tca_daemon, kg):
    lift_on(tca_daemon, kg)
    assert kg == 4.0
"""


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Return a folder with the plugin's entry point, as an installation has it."""
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    (tmp_path / "tca_as_installed-0.dist-info").mkdir()
    entry_point = config["options.entry_points"]["pytest11"]
    (tmp_path / "tca_as_installed-0.dist-info" / "entry_points.txt").write_text(
        f"[pytest11]{entry_point}\n"
    )
    return tmp_path


def run_pytest(installed: Path, folder: Path, *options: str) -> tuple[int, str]:
    """Run the tests of *folder* as a user does: central's address and the path are not inherited.

    Return exit code and report.
    """
    inherited = {"TCA_CENTRAL", "PYTHONSAFEPATH"}
    environment = {name: value for name, value in os.environ.items() if name not in inherited}
    environment["PYTHONPATH"] = f"{installed}{os.pathsep}{ROOT}"
    left_out = [
        f"-pno:{name}" for name in ("cacheprovider", "anyio", "hypothesispytest", "pytest_cov")
    ]
    command = (sys.executable, "-m", "pytest", *left_out, "-rA", *options)
    base = f"--basetemp={installed / 'base'}"
    done = subprocess.run(
        [*command, base], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout + done.stderr


def test_fixtures_work_side_by_side_and_keep_journals(installed: Path) -> None:
    folder = installed / "robot"
    folder.mkdir()
    (folder / "test_lifting.py").write_text(USERS_TESTS)
    _, report = run_pytest(installed, folder, "-n", "2", "--strict-markers")
    passed, failed = (
        set(re.findall(rf"^{end} \S+::(\S+)", report, re.MULTILINE)) for end in ("PASSED", "FAILED")
    )
    assert failed == {"test_failing_stepped", "test_daemon[5.0]"}, report
    assert passed == {"test_stepped", "test_real_clock", "test_daemon[4.0]"}
    assert re.search(
        r"^ +0\.000  received: command lift \{1\} from test: 3\.0$", report, re.MULTILINE
    )
    journals = [Path(name) for name in re.findall(r"^tca log show (.+)$", report, re.MULTILINE)]
    lifted = [
        fact.message
        for journal in journals
        for entry in open_log(journal)
        for fact in entry.facts
        if isinstance(fact, Received)
    ]
    assert lifted == ["lift", "lift"]
    kept = {path for path in installed.glob("base/popen-*/tca[0-9]*") if path.is_dir()}
    assert kept == {journal.parent for journal in journals}


@pytest.mark.parametrize("chosen", ["not restart", pytest.param("restart", marks=pytest.mark.soak)])
def test_tests_of_the_five_programs_pass(installed: Path, chosen: str) -> None:
    code, report = run_pytest(installed, ROOT / "examples" / "courier", "-k", chosen)
    assert code == pytest.ExitCode.OK, report
