"""``tca activities``: which application it means, and what it says if there is none."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from integration.programs import central

from tca_activities import Application
from tca_activities.manager import Manager
from tca_activities.page.command import activities
from tca_module import Module


def said(address: str, *arguments: str) -> str:
    """What the command says that does not serve a page."""
    result = CliRunner().invoke(activities, [*arguments, "--central", address, "--no-browser"])
    assert result.exit_code == 1
    return result.output.strip()


@pytest.mark.slow
def test_the_application_is_found_or_asked_for(tmp_path: Path) -> None:
    with central(tmp_path, "--quiet") as daemon:
        assert said(daemon.address) == "Error: central knows no application: start its program, with a Manager"
        module = Module("robot", daemon.address)
        for name in ("arm", "base"):
            Manager(Application(name)).handle_in(module)
        with module.running():
            assert said(daemon.address).endswith("several applications: give the name of one of 'arm', 'base'")
            assert said(daemon.address, "leg").endswith("no application 'leg': it knows 'arm', 'base'")
            assert "can't serve there" in said(daemon.address, "arm", "--host", "192.0.2.1")
    assert "does not answer" in said(daemon.address)
