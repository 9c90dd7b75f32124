"""Continue a random life from an image, in a separate process: ``separate_life.py SEED IMAGE``."""

import sys
from hashlib import blake2b
from pathlib import Path

import msgspec
from central.player import Player
from properties.life import Life

from tca_central.events import Effect
from tca_central.image.decoder import decode
from tca_central.image.encoder import encode

EVENTS = 250


class _DigestingPlayer(Player):
    """A player that keeps a digest of all effects."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.all_effects = blake2b()

    def note(self, effects: list[Effect]) -> None:
        super().note(effects)
        self.all_effects.update(msgspec.msgpack.encode(effects))


def live(seed: int, image: bytes | None) -> tuple[bytes, str]:
    """Return the image after the first half of a life, and a digest of the effects of both halves.
    The second half starts from *image*, if one is given.
    """
    player = _DigestingPlayer()
    life = Life(player)
    life.go_on(seed, EVENTS)
    own_image = encode(player.central)
    if image is not None:
        player.central = decode(image)
    life.go_on(seed + 1, EVENTS)
    return own_image, player.all_effects.hexdigest()


def digest(image: bytes) -> str:
    return blake2b(image).hexdigest()


if __name__ == "__main__":
    own_image, effects = live(int(sys.argv[1]), Path(sys.argv[2]).read_bytes())
    print(digest(own_image), effects)
