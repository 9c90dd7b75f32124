"""Licences: proofs that central allows a sender to send messages to a slot directly.

Central makes a licence for each sender from the secret key of the slot's entrance. A slot therefore
needs no list of senders, only a list of revoked licences.
"""

import hashlib
import hmac


def licence(entrance_key: str, number: str) -> str:
    """Return the licence of that *number* for the entrance with that key."""
    return f"{number}/{_proof(entrance_key, number)}"


def number_of(shown: str, entrance_key: str) -> str | None:
    """Return the number of a licence shown at the entrance with that key; None if it is invalid."""
    number, _, proof = shown.rpartition("/")
    expected = _proof(entrance_key, number)
    # compare_digest takes the same time for all proofs, so no part of one can be guessed.
    is_valid = hmac.compare_digest(proof.encode(), expected.encode())
    return number if number and is_valid else None


def _proof(entrance_key: str, number: str) -> str:
    return hmac.new(entrance_key.encode(), number.encode(), hashlib.sha256).hexdigest()
