"""The folded states of tasks equal central's, and keep the rules of their life cycles."""

from typing import Any

from central.transcript import Transcript
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from properties.folded import Folding
from properties.life import OPERATIONS, Life, Operations, small
from tools.runs import OPENED, TRANSCRIPTS, checked

from tca_central.model.tasks import Task
from tca_tools.journal.fold import History
from tca_tools.journal.lives import life_at
from tca_wire.life_cycles import GENERAL
from tca_wire.packets.headers import Register
from tca_wire.vocabulary import Party

HANDLER_OPTIONS: dict[str, dict[str, Any]] = {
    "step": {"takes": ["update", "cancel"]},
    "move": {"accepts": True, "takes": ["update", "cancel"]},
    "lift": {"refuses": ["update"]},
}
BY_CLIENTS, BY_SERVERS = GENERAL.names(Party.CLIENT), GENERAL.names(Party.SERVER)
operation = st.tuples(st.sampled_from(OPERATIONS + ["ask", "say"] * 6), *[small] * 4)


class ComparedPlayer(Folding):
    """A player that compares the states of all living tasks. Some handlers have options."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.history = History()

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        if isinstance(header, Register):
            changed = [
                one if one.takes else replace(one, **HANDLER_OPTIONS.get(one.message, {}))
                for one in header.handlers
            ]
            header = replace(header, handlers=changed)
        return super().receive(connection, header, body)

    def compare(self) -> None:
        for number, task in self.central.tree.tasks.items():
            record = self.history.tasks.get(number)
            if record is not None and not (record.retries and record.message_class.is_monitor):
                life = life_at(self.history, record)
                assert (life.state, life.serial) == (task.state, task.serial), (
                    str(task),
                    len(self.entries),
                )
                assert record.body == task.body, (str(task), len(self.entries))


class ChangingLife(Life):
    """A life in which clients request changes of tasks, and handlers report changes."""

    def ask_(self, a: int, b: int, c: int, d: int) -> None:
        tasks = list(self.central.tree.tasks.values())
        if tasks:
            task = tasks[a % len(tasks)]
            name = BY_CLIENTS[b % len(BY_CLIENTS)] if d % 4 else "update"
            serial = (-1, task.serial, max(task.serial - 1, 0))[c % 3]
            self.player.change(
                "user", task.id, name, b if name == "update" else None, serial=serial
            )

    def say_(self, a: int, b: int, c: int, _: int) -> None:
        running = [one for one in self.central.dispatcher.running.values() if isinstance(one, Task)]
        if running:
            task = running[a % len(running)]
            assert task.slot is not None
            possible = [
                one.name
                for one in GENERAL.transitions
                if one.source == task.state and one.name in BY_SERVERS
            ]
            names = possible if c % 5 else BY_SERVERS
            name = names[b % len(names)]
            serial = (-1, task.serial, max(task.serial - 1, 0))[c % 3]
            value = b if name == "result available" else None
            self.player.change(
                task.slot.id.decode(), task.id, name, value, serial=serial, origin=task.handling_id
            )


@given(st.lists(operation, max_size=60))
@settings(max_examples=40)
def test_folded_task_states_match_central_in_random_life(taken: Operations) -> None:
    life = ChangingLife(ComparedPlayer()).live(taken)
    assert checked([OPENED, *life.player.entries]) == []
    for start in range(5, len(life.player.entries), 20):
        assert checked(life.player.entries[start:]) == []


def test_folded_task_states_match_central_in_every_transcript() -> None:
    for path in TRANSCRIPTS.glob("*.txt"):
        transcript = Transcript()
        transcript.player = ComparedPlayer()
        for block in path.read_text().strip().split("\n\n")[1:]:
            for command in block.split("\n----")[0].splitlines():
                transcript.play(command)
