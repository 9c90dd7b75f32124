"""A play as bytes. Loading it takes less time than replaying the run, however long the run is.

Pickle copies all that a play holds except the objects that all plays share: the scenario, programs,
script runs and life cycles of tasks. The snapshot refers to shared objects by their ``id()``, so it
is valid in this process only. The connections of central's outputs
(``Central.connect_outputs``) are no state, and are recreated for the copy.
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
"""Types of objects in a slot's session that hold no state: the copy gets an empty object."""

_ATOMS = (MessageId, RequestNumber)

# ruff: noqa: SLF001


class Snapshots:
    """Saves plays as snapshots, and loads them."""

    def __init__(self) -> None:
        # By id(). The references keep the objects alive, so that no id is used again.
        self._shared: dict[int, Any] = {}

    def save(self, play: Play) -> bytes:
        """Return a snapshot of *play*, which stays usable."""
        out, central = io.BytesIO(), play.central
        central._outputs = central._output_queues = ()
        _Pickler(out, self._shared).dump(play)
        central.connect_outputs()
        return out.getvalue()

    def load(self, snapshot: bytes) -> Play:
        """Return a new play in the state that was saved."""
        _loading.append(self._shared)
        try:
            found: Play = pickle.loads(snapshot)  # noqa: S301 - written by ``save`` above
        finally:
            _loading.pop()
        found.central.connect_outputs()
        return found


class _Pickler(pickle.Pickler):
    def __init__(self, out: io.BytesIO, shared: dict[int, Any]) -> None:
        super().__init__(out, pickle.HIGHEST_PROTOCOL)
        self._shared = shared

    def reducer_override(self, thing: Any) -> Any:
        """Return how *thing* is pickled; pickle calls this for all but plain values."""
        kind = type(thing)
        if kind in _ATOMS:
            return kind, (int(thing),)
        if kind in _EMPTY:
            return _EMPTY[kind], ()
        if isinstance(thing, _SHARED):
            self._shared[id(thing)] = thing
            return _shared_object, (id(thing),)
        return NotImplemented


_loading: list[dict[int, Any]] = []
"""The objects shared with the snapshot that is being loaded."""


def _shared_object(number: int) -> Any:
    return _loading[-1][number]
