"""How long a resource was kept from others by locks and reservations, or by who waited for one. Pure.

A lock holds in all copies of a module. Who wants one keeps those out that come after him, until what is handled there
is done; so his wait counts from when they came.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import accumulate
from operator import attrgetter

from tca_tools.run.records import Claim
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover
from tca_wire.text.facts_in_words import called


@dataclass(slots=True)
class _OfOne:
    """The locks of a resource that keep a sender's messages out."""

    claims: list[Claim]
    """As they were asked for."""
    places: dict[int, int]
    """By number where they are in that."""
    in_force: Cover
    waited: list[float]
    """For each until when it or one before it was waited for."""
    over: list[float]
    """For each until when it or one before it lasted."""


class Locks:
    """The locks and reservations of a run; each question costs O(log n)."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._known: dict[tuple[str, str, str], _OfOne] = {}
        reserved = ((key, one.sender) for key, claims in run.wanted.items() for one in claims if one.is_reserved)
        self._reserving = {(*key, sender) for key, sender in reserved}

    def kept_out(self, module: str, resource: str, sender: str, start: float, end: float) -> float:
        """How many seconds of a stay in the queue of a resource were because of them. What is reserved by who sent the
        message does not keep it out.
        """
        locks = self._of(module, resource, sender)
        before = bisect_right(locks.claims, start, key=_START)
        since = min(max(locks.waited[before - 1], start), end) if before else start
        return since - start + locks.in_force.within(since, end)

    def ahead_of(self, claim: Claim, end: float) -> float:
        """How many seconds of the wait for one, until *end*, there was another ahead of it."""
        locks = self._of(claim.module, claim.resource, "")
        before = locks.places[claim.id]
        return max(min(locks.over[before - 1], end) - claim.start, 0.0) if before else 0.0

    def last_before(self, module: str, resource: str, end: float) -> Claim | None:
        """The last that was granted before *end*; if none was, the last that was asked for."""
        grants = self._run.granted(module, resource)
        if granted := bisect_left(grants, end, key=attrgetter("granted")):
            return grants[granted - 1]
        wanted = self._run.asked_for(module, resource)
        asked = bisect_left(wanted, end, key=_START)
        return wanted[asked - 1] if asked else None

    def _of(self, module: str, resource: str, sender: str) -> _OfOne:
        own = sender if (called(module), resource, sender) in self._reserving else ""
        key = (called(module), resource, own)
        if (known := self._known.get(key)) is None:
            wanted = self._run.asked_for(module, resource)
            claims = [claim for claim in wanted if not (own and claim.is_reserved and claim.sender == own)]
            known = self._known[key] = self._made(claims)
        return known

    def _made(self, claims: list[Claim]) -> _OfOne:
        over = [self._run.time if claim.end is None else claim.end for claim in claims]
        waited = [last if claim.granted is None else claim.granted for claim, last in zip(claims, over, strict=True)]
        spans = [
            (claim.granted, last) for claim, last in zip(claims, over, strict=True) if claim.granted is not None
        ]  # fmt: skip
        places = {claim.id: place for place, claim in enumerate(claims)}
        return _OfOne(claims, places, Cover(spans), list(accumulate(waited, max)), list(accumulate(over, max)))


_START = attrgetter("start")
