"""The docstrings of the packages, as griffe reads them from the source."""

from functools import cache

from griffe import Attribute, Class, Docstring, GriffeLoader, ModulesCollection, Object

from dev.site.root import ROOT


@cache
def packages() -> ModulesCollection:
    """Return the packages whose docstrings are quoted."""
    loader = GriffeLoader(search_paths=[ROOT])
    for name in ("tca_wire", "tca_module", "tca_tools"):
        loader.load(name)
    return loader.modules_collection


def members(path: str) -> dict[str, Attribute]:
    """Return the attributes of a module or class, in the order of the source."""
    found: Object = packages()[path]
    return {
        name: one
        for name, one in found.members.items()
        if isinstance(one, Attribute) and not name.startswith("_")
    }


def text_of(documented: Object) -> str:
    """Return a docstring; "" without one."""
    docstring: Docstring | None = documented.docstring
    return docstring.value if docstring is not None else ""


def fields(kind: type) -> dict[str, str]:
    """Return the fields of a struct with their docstrings, those of its bases first."""
    found: Class = packages()[f"{kind.__module__}.{kind.__qualname__}"]
    bases = [one for one in kind.__mro__[1:] if one.__module__.startswith("tca_")]
    inherited: dict[str, str] = fields(bases[0]) if bases else {}
    own = {name: text_of(one) for name, one in members(found.path).items() if one.annotation}
    return inherited | own
