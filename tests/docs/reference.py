"""The names that the pages of the reference describe."""

import re
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import griffe
import msgspec
from docs.pages import DOCS

from dev.site.parts import PARTS_BY_NAME

PACKAGES = ("tca_wire", "tca_module", "tca_tools", "tca_behaviours")
DIRECTIVE = re.compile(r"^::: (?P<path>[\w.]+)\n(?P<options>(?:    .*\n)*)", re.MULTILINE)
ROW = re.compile(r"^\| ?`(?P<name>\w+)` ?\|", re.MULTILINE)
SNIPPET = re.compile(r'^--8<-- "(?P<name>[\w-]+)\.md"$', re.MULTILINE)


class Described(NamedTuple):
    """A name on a page."""

    page: str
    path: str
    options: dict[str, object]

    @property
    def name(self) -> str:
        return self.path.rpartition(".")[2]


@cache
def described() -> list[Described]:
    """Return the names that pages describe by themselves: in directives, or as rows of a table."""
    found = []
    for page in sorted((DOCS / "reference").glob("*.md")):
        text = page.read_text()
        for one in DIRECTIVE.finditer(text):
            options = msgspec.yaml.decode(one["options"] or "{}").get("options", {})
            found.append(Described(page.stem, one["path"], options))
        for part in SNIPPET.finditer(text):
            text += PARTS_BY_NAME[part["name"]]()
        found += [Described(page.stem, one["name"], {}) for one in ROW.finditer(text)]
    return found


@cache
def sources() -> griffe.ModulesCollection:
    """Return the packages, read as the site reads them."""
    loader = griffe.GriffeLoader(
        extensions=griffe.load_extensions("dev.site.docstrings"),
        docstring_parser=griffe.Parser.google,
    )
    for name in PACKAGES:
        loader.load(name)
    loader.resolve_aliases()
    return loader.modules_collection


def shown(one: Described) -> Iterator[griffe.Object]:
    """Yield what a directive shows: an object, and its members."""
    kind = sources()[one.path]
    yield kind
    if not kind.is_class:
        return
    wanted, inherited = one.options.get("members"), one.options.get("inherited_members", False)
    filters = [str(each) for each in one.options.get("filters", ["!^_"])]  # type: ignore[attr-defined]
    for name, member in {**(kind.inherited_members if inherited else {}), **kind.members}.items():
        is_inherited = name not in kind.members
        if is_inherited and isinstance(inherited, list) and name not in inherited:
            continue
        if wanted is False or (isinstance(wanted, list) and name not in wanted):
            continue
        if any(re.search(each.removeprefix("!"), name) for each in filters):
            continue
        if member.docstring is not None:
            yield member
