"""Which run tools show that are given none."""

import shutil
from pathlib import Path

import pytest
from integration.programs import central

from tca_tools.errors import UnusableLog
from tca_tools.run.journals import newest_journal


def test_tools_find_the_newest_run_wherever_its_journal_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with central(tmp_path / "old") as old:
        pass
    assert newest_journal().resolve() == old.journal.resolve()
    shutil.rmtree(old.journal)
    with central(tmp_path / "new") as new:
        assert newest_journal().resolve() == new.journal.resolve()
    assert len(list((tmp_path / "state/tca/journals").iterdir())) == 1  # of what is gone no link stays


def test_tools_look_at_the_run_of_the_central_that_is_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with central(tmp_path / "a") as one, central(tmp_path / "b", bind="tcp://127.0.0.1:*") as other:
        monkeypatch.setenv("TCA_CENTRAL", one.address)
        assert newest_journal() == one.journal.resolve()
        monkeypatch.setenv("TCA_CENTRAL", other.first_line.split()[-1].replace("127.0.0.1", "localhost"))
        assert newest_journal() == other.journal.resolve()
    monkeypatch.setenv("TCA_CENTRAL", "tcp://robot:7000")
    with pytest.raises(UnusableLog, match=r"no journal of the central at tcp://robot:7000 \(\$TCA_CENTRAL\)"):
        newest_journal()
    monkeypatch.delenv("TCA_CENTRAL")
    assert newest_journal().resolve() == other.journal.resolve()
