"""Rights: what the permissions file allows one connection. Knows messages by their names only."""

from collections.abc import Iterable
from fnmatch import fnmatchcase

from tca_central.events import AccessRule
from tca_central.model.stored import Stored
from tca_wire.vocabulary import Permission

OWNER = "owner"
"""The name of central's own user in the permissions file."""

_REMEMBERED = 4096  # cached decisions per connection


class Rights(Stored):
    """The patterns that apply to one connection, and a cache of decisions."""

    __slots__ = ("known", "patterns")

    def __init__(self, patterns: dict[Permission, tuple[str, ...]]) -> None:
        self.patterns = patterns
        self.known: dict[tuple[Permission, str], bool] = {}

    def allow(self, permission: Permission, name: str) -> bool:
        """Whether *permission* includes *name*, the name of a message or a request."""
        asked = permission, name
        allowed = self.known.get(asked)
        if allowed is None:
            allowed = matches(name, self.patterns.get(permission, ()))
            if len(self.known) >= _REMEMBERED:
                self.known.clear()
            self.known[asked] = allowed
        return allowed


class Permissions(Stored):
    """The rules of access, and the owners of outcomes."""

    __slots__ = ("outcome_owners", "rules")

    def __init__(self) -> None:
        self.rules: tuple[AccessRule, ...] | None = None  #: None: all users may do everything
        #: By ended task with a stored outcome: the principal that sent the task.
        self.outcome_owners: dict[int, str] = {}


def matches(name: str, patterns: Iterable[str]) -> bool:
    """Whether a name matches one of the patterns."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def rights_of(rules: Iterable[AccessRule], principal: str, module: str) -> Rights | None:
    """Return a principal's rights in a module of that name; None if no rule admits the module."""
    owner = principal or OWNER
    found = [rule for rule in rules if matches(owner, rule.keys) and matches(module, rule.modules)]
    if not found:
        return None
    patterns: dict[Permission, tuple[str, ...]] = {}
    for rule in found:
        for permission, names in rule.allowed:
            patterns[permission] = (*patterns.get(permission, ()), *names)
    return Rights(patterns)
