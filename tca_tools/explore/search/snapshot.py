"""A play as bytes, to go on from it more than once: faster than playing it again, however long the
run.

Pickle copies what a play holds, except what all plays share (the scenario, its programs, what
scripts have lived, the rules and life cycles of tasks): that is named by its number in memory, so
snapshots are good for this process only. Where central's results go (``Central.connect_outputs``)
is no state, and made anew for the copy.
"""

import io
import pickle
from collections.abc import Callable
from threading import Lock
from typing import Any
from weakref import WeakValueDictionary

from tca_tools.explore.play.identifiers import MessageId, RequestNumber
from tca_tools.explore.play.play import Play
from tca_tools.explore.scenario.scenario import Scenario, ScenarioModule
from tca_tools.explore.scenario.script import Program
from tca_tools.explore.scenario.steps import Branch, ScriptRun
from tca_wire.life_cycles import LifeCycle
from tca_wire.messages.declarations import Message

_SHARED = (Scenario, ScenarioModule, Program, ScriptRun, Branch, Message, LifeCycle)

_EMPTY: dict[type, Callable[[], Any]] = {
    type(Lock()): Lock,
    WeakValueDictionary: WeakValueDictionary,
}
"""Of a slot's session: nothing of a scenario is in these."""

_ATOMS = (MessageId, RequestNumber)

# ruff: noqa: SLF001


class Snapshots:
    """Makes snapshots, and plays of them."""

    def __init__(self) -> None:
        self._shared: dict[int, Any] = {}  #: by id(); kept, so that the ids stay theirs

    def save(self, play: Play) -> bytes:
        """A play that can be had again."""
        out, central = io.BytesIO(), play.central
        central._outputs = central._output_queues = ()
        _Pickler(out, self._shared).dump(play)
        central.connect_outputs()
        return out.getvalue()

    def load(self, snapshot: bytes) -> Play:
        """A play as it was when it was saved."""
        _loading.append(self._shared)
        try:
            found: Play = pickle.loads(snapshot)  # noqa: S301 - it is our own
        finally:
            _loading.pop()
        found.central.connect_outputs()
        return found


class _Pickler(pickle.Pickler):
    def __init__(self, out: io.BytesIO, shared: dict[int, Any]) -> None:
        super().__init__(out, pickle.HIGHEST_PROTOCOL)
        self._shared = shared

    def reducer_override(self, thing: Any) -> Any:
        """Called for all but plain values."""
        kind = type(thing)
        if kind in _ATOMS:
            return kind, (int(thing),)
        if kind in _EMPTY:
            return _EMPTY[kind], ()
        if isinstance(thing, _SHARED):
            self._shared[id(thing)] = thing
            return _known, (id(thing),)
        return NotImplemented


_loading: list[dict[int, Any]] = []
"""The objects shared with the snapshot that is being loaded."""


def _known(number: int) -> Any:
    return _loading[-1][number]
