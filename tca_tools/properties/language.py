"""Properties as text.

The grammar, where P is a predicate (see predicates.py)::

    PROPERTY   never P | always P | eventually P | P before P | never stuck
               at most N P | at most N P in all
"""

import re

from tca_tools.properties import algebra
from tca_tools.properties.algebra import Property
from tca_tools.properties.field_values import blanked, in_one_line
from tca_tools.properties.predicates import predicate_from
from tca_tools.properties.world import BadProperty

_SHAPES = (
    "'never P', 'always P', 'eventually P', 'P before P', 'at most N P', 'at most N P in all' or "
    "'never stuck'"
)
_UNARY = {
    "never": algebra.never,
    "always": algebra.always,
    "eventually": algebra.eventually,
}


def property_from(text: str) -> Property:
    """Return the property that a text states.

    Args:
        text: the property, such as "at most 1 planned ahead of take steps".

    Raises:
        BadProperty: the text is not a property; the message names the error.
    """
    words = in_one_line(text)
    try:
        found = _property(words)
    except BadProperty as error:
        raise BadProperty(f"property '{words}': {error}") from None
    found.words = words
    return found


def _property(text: str) -> Property:
    if text == "never stuck":
        return algebra.never_stuck()
    first, _, rest = text.partition(" ")
    if text.startswith("at most"):
        return _at_most(text.removeprefix("at most").strip())
    if first in _UNARY and rest:
        return _UNARY[first](predicate_from(rest))
    if " before " in text:
        return _before(text)
    raise BadProperty(f"unknown form: write {_SHAPES}")


def _at_most(text: str) -> Property:
    number, _, rest = text.partition(" ")
    if not number.isdecimal():
        raise BadProperty(f"'{number}' is not a whole number from 0: write 'at most 1 ...'")
    if rest.endswith(" in all"):
        return algebra.at_most_in_all(int(number), predicate_from(rest.removesuffix(" in all")))
    return algebra.at_most(int(number), predicate_from(rest))


def _before(text: str) -> Property:
    """Split at the only "before" between two predicates: names may contain the word, too."""
    found, wrong = [], ""
    for match in re.finditer(" before ", blanked(text)):
        try:
            first = predicate_from(text[: match.start()])
            found.append((first, predicate_from(text[match.end() :])))
        except BadProperty as error:
            wrong = wrong or str(error)
    if not found:
        raise BadProperty(wrong or "'before' is only in quotes")
    if len(found) > 1:
        raise BadProperty("it can be read in several ways: put the names of messages in quotes")
    return algebra.before(*found[0])
