"""The fingerprint of a state ignores attributes by their names. Each of these names must exist."""

from collections.abc import Iterator

from tca_central.core import Central
from tca_central.model.stored import Stored
from tca_tools.explore.search.fingerprint import IGNORED


def subclasses(kind: type) -> Iterator[type]:
    direct: list[type] = kind.__subclasses__()
    for subclass in direct:
        yield subclass
        yield from subclasses(subclass)


def test_every_ignored_attribute_is_a_slot() -> None:
    kinds = {kind.__name__: kind for kind in (Central, *subclasses(Stored))}
    for name, ignored in IGNORED.items():
        parents = kinds[name].__mro__
        slots = {slot for parent in parents for slot in getattr(parent, "__slots__", ())}
        assert ignored <= slots, f"{name} has no {ignored - slots}"
