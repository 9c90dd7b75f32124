"""Rights: what one connection may do, as the permissions file has it. Knows nothing of messages but
their names.
"""

from collections.abc import Iterable
from fnmatch import fnmatchcase

from tca_central.events import AccessRule
from tca_central.model.stored import Stored
from tca_wire.vocabulary import Permission

OWNER = "owner"
"""What permissions call the user who runs central."""

MOST_LICENCES = 10_000
"""Licences that are valid: one for each sender of direct messages, whether it is connected or
not.
"""
MOST_BARRED = 10_000

_REMEMBERED = 4096  # names


class Rights(Stored):
    """The patterns that apply to one connection, and what they have said of names."""

    __slots__ = ("known", "patterns")

    def __init__(self, patterns: dict[Permission, tuple[str, ...]]) -> None:
        self.patterns = patterns
        self.known: dict[tuple[Permission, str], bool] = {}

    def allow(self, permission: Permission, name: str) -> bool:
        """Whether it may do that with what is called so."""
        asked = permission, name
        allowed = self.known.get(asked)
        if allowed is None:
            allowed = matches(name, self.patterns.get(permission, ()))
            if len(self.known) >= _REMEMBERED:
                self.known.clear()
            self.known[asked] = allowed
        return allowed


class Permissions(Stored):
    """The rules, what they need to know of the past, and the licences to send directly."""

    __slots__ = ("barred", "licences", "newest_licence", "outcome_owners", "rules")

    def __init__(self) -> None:
        self.rules: tuple[AccessRule, ...] | None = (
            None  #: None: whoever is let in may do everything
        )
        self.outcome_owners: dict[
            int, str
        ] = {}  #: of ended tasks whose outcome is kept: whose they were, under rules
        self.licences: dict[
            int, str
        ] = {}  #: those that are valid, and whose they are; oldest first
        self.newest_licence = 0
        self.barred: list[int] = []  #: the newest that are not valid any more

    def new_licence(self, principal: str) -> int:
        """A licence to send directly."""
        self.newest_licence += 1
        self.licences[self.newest_licence] = principal
        return self.newest_licence

    def bar(self, numbers: list[int]) -> None:
        """These licences are not valid any more."""
        for number in numbers:
            self.licences.pop(number, None)
        self.barred = (self.barred + numbers)[-MOST_BARRED:]


def matches(name: str, patterns: Iterable[str]) -> bool:
    """Whether a name fits one of the patterns."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def rights_of(rules: Iterable[AccessRule], principal: str, module: str) -> Rights | None:
    """The rights of a principal as a module of that name; None if no rule is about it: it is not
    let in.
    """
    who = principal or OWNER
    found = [rule for rule in rules if matches(who, rule.keys) and matches(module, rule.modules)]
    if not found:
        return None
    patterns: dict[Permission, tuple[str, ...]] = {}
    for rule in found:
        for permission, names in rule.allowed:
            patterns[permission] = (*patterns.get(permission, ()), *names)
    return Rights(patterns)
