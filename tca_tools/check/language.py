"""Properties as text, as the explorer words them.

PROPERTY   never P | always P | at most N P | at most N P in all | P before P | eventually P | never stuck
P          a predicate: see predicates.py
"""

import re

from tca_tools.check import properties
from tca_tools.check.errors import BadProperty
from tca_tools.check.predicates import predicate_from
from tca_tools.check.properties import Property
from tca_tools.check.wanted_data import blanked, in_one_line

_SHAPES = "'never P', 'always P', 'at most N P', 'at most N P in all', 'P before P', 'eventually P' and 'never stuck'"


def property_from(text: str) -> Property:
    """The property that a text states. Raises BadProperty."""
    words = in_one_line(text)
    try:
        found = _property(words)
    except BadProperty as error:
        raise BadProperty(f"property '{words}': {error}") from None
    found.words = words
    return found


def _property(text: str) -> Property:
    if text == "never stuck":
        return properties.never_stuck()
    if text.startswith("at most"):
        return _at_most(text.removeprefix("at most").strip())
    for shape, make in (
        ("never", properties.never),
        ("always", properties.always),
        ("eventually", properties.eventually),
    ):
        if text.startswith(f"{shape} "):
            return make(predicate_from(text.removeprefix(shape).strip()))
    if " before " in text:
        return _before(text)
    raise BadProperty(f"it has no shape that is known: {_SHAPES} are")


def _at_most(text: str) -> Property:
    number, _, rest = text.partition(" ")
    if not number.isdecimal():
        raise BadProperty(f"'{number}' is no whole number from 0 on: write 'at most 1 ...'")
    if rest.endswith(" in all"):
        return properties.at_most_in_all(int(number), predicate_from(rest.removesuffix(" in all")))
    return properties.at_most(int(number), predicate_from(rest))


def _before(text: str) -> Property:
    """Names may have the word in them, too: the one place counts where both sides make sense."""
    blank = blanked(text)
    found, wrong = [], ""
    for match in re.finditer(" before ", blank):
        try:
            found.append((predicate_from(text[: match.start()]), predicate_from(text[match.end() :])))
        except BadProperty as error:
            wrong = wrong or str(error)
    if not found:
        raise BadProperty(wrong or "'before' stands in quotes only")
    if len(found) > 1:
        raise BadProperty("it can be read in several ways: put the names of messages in quotes")
    return properties.before(*found[0])
