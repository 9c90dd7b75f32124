"""One heap of events and one source of chance, so that the seed determines a life."""

import random
from collections.abc import Callable
from hashlib import blake2b
from heapq import heappop, heappush
from typing import Any

import msgspec


class Broken(AssertionError):
    """A promise that was broken."""


class Clockwork:
    """A queue of events. They run in the order of their times; at equal times, in the order of
    their creation.
    """

    def __init__(self, seed: int, *, write_trace: Callable[[str], None] | None = None) -> None:
        self.now = 0.0
        self.dice = random.Random(seed)
        self.happened = 0
        self._heap: list[tuple[float, int, Callable[..., object], tuple[Any, ...]]] = []
        self._made = 0
        self._write_trace = write_trace
        self._hash = blake2b(digest_size=8)

    def after(self, seconds: float, do: Callable[..., object], *about: Any) -> None:
        """Schedule an event."""
        self._made += 1
        heappush(self._heap, (self.now + seconds, self._made, do, about))

    def step(self) -> bool:
        """Run the next event. Return False if there is none."""
        if not self._heap:
            return False
        self.now, _, do, about = heappop(self._heap)
        self.happened += 1
        do(*about)
        return True

    def chance(self, of: float) -> bool:
        """Whether an event with probability *of* happens now."""
        return of > 0 and self.dice.random() < of

    def between(self, low: float, high: float) -> float:
        """Return a random number between *low* and *high*."""
        return low + (high - low) * self.dice.random()

    # --- trace and digest -------------------------------------------------------------------------

    @property
    def has_trace_reader(self) -> bool:
        """Whether the trace has a reader."""
        return self._write_trace is not None

    def note(self, what: bytes) -> None:
        """Add something to the digest."""
        self._hash.update(b"%f " % self.now)
        self._hash.update(what)

    def trace(self, who: str, what: object) -> None:
        """Write a line of the trace."""
        if self._write_trace is not None:
            self._write_trace(f"{self.now:9.4f}  {who:<14} {what}")

    @property
    def digest(self) -> str:
        """The digest of everything noted. Equal lives have equal digests."""
        return self._hash.hexdigest()


def shown(header: msgspec.Struct) -> str:
    """Return a header as a short text, without default values."""
    usual = header.__struct_defaults__
    names = header.__struct_fields__
    defaults = dict(zip(names[len(names) - len(usual) :], usual, strict=True))
    fields = [
        f"{name}={_short(value)}"
        for name in names
        if (value := getattr(header, name)) != defaults.get(name, _NONE)
    ]
    return f"{type(header).__name__}({', '.join(fields)})"


_NONE = object()


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 3:
        return f"[{len(value)}]"
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    return str(value)[:60] if not isinstance(value, int) else str(int(value))
