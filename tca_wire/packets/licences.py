"""Licences: by what a slot knows that central lets a sender send to it directly.

Central makes one for each sender out of the key of the slot's entrance, which nobody else has; so
the slot needs no list of senders, only one of the licences that are not valid any more.
"""

import hashlib
import hmac


def licence(entrance_key: str, number: str) -> str:
    """The licence of that *number* for the entrance with that key."""
    return f"{number}/{_proof(entrance_key, number)}"


def number_of(shown: str, entrance_key: str) -> str | None:
    """The number of a licence that was shown at the entrance with that key; None if it is none."""
    number, _, proof = shown.rpartition("/")
    expected = _proof(entrance_key, number)
    return number if number and hmac.compare_digest(proof.encode(), expected.encode()) else None


def _proof(entrance_key: str, number: str) -> str:
    return hmac.new(entrance_key.encode(), number.encode(), hashlib.sha256).hexdigest()
