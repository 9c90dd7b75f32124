"""A leader whose append is refused writes nothing to its journal that is not in the log."""

from pathlib import Path

import pytest
from log_model import LogModel, ModelLog

from tca_central.events import Input, MembersChanged, Record
from tca_central.inputs import events_of
from tca_central.replication.member import Member
from tca_central.replication.shared_log import Deposed
from tca_central.shell.log_writer import Sync, files_of
from tca_central.shell.run_log import RunLog
from tca_central.shell.store import Store
from tca_wire.journal import facts
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader


class Leader:
    """A server without sockets."""

    def __init__(self, member: Member) -> None:
        self.member = member
        self.log: RunLog | None = None
        self.stopping = ""
        member.open(self, Sync.BATCH)

    def handle_input(self, event: Input) -> None:
        """Log an input, and handle it."""
        assert self.log is not None
        self.log.add_input(event)
        for one in events_of(event):
            for effect in self.member.central.handle(one):
                if isinstance(effect, Record):
                    self.log.add_entry(effect.entry)

    def flush(self) -> None:
        """End a turn."""
        assert self.log is not None
        self.log.flush(self.member.central)


def member(model: LogModel, folder: Path) -> Member:
    """Return a member with a journal in a folder."""
    return Member(ModelLog(model), f"ipc://{folder}", folder, Store(), clock=model.clock)


def leaders_in(folder: Path) -> list[str]:
    """Return the leaders that a journal names."""
    found = []
    for path in files_of(folder, SEGMENT_SUFFIX):
        with path.open("rb") as stream:
            for entry in JournalReader(stream):
                found += [
                    one.leader for one in entry.facts if isinstance(one, facts.MembersChanged)
                ]
    return found


def test_deposed_leader_writes_only_facts_of_the_log(tmp_path: Path) -> None:
    model = LogModel()
    first, second = (member(model, tmp_path / name) for name in ("first", "second"))
    first.begin(is_fresh=False)
    leader = Leader(first)
    leader.handle_input(MembersChanged(0.0, "first", ""))
    leader.flush()
    second.lead_now()
    assert second.stand_by(lambda: False)
    leader.handle_input(MembersChanged(1.0, "first again", ""))
    with pytest.raises(Deposed):
        leader.flush()
    for one in (first, second):
        one.close()
    assert leaders_in(tmp_path / "first") == leaders_in(tmp_path / "second") == ["first"]
