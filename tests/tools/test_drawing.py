"""Guesses of how wide texts are in pictures: near enough that legends have no holes, and never too small."""

import pytest

from tca_tools.drawing.svg import width_of


@pytest.mark.parametrize(
    ("words", "pixels"),
    [  # as a browser measures them in the letters of our pictures
        ("waiting for a reply, task or lock", 160),
        ("failed, and handled", 101),
        ("traverse path", 70),
        ("MOVE WHEELS", 89),
        ("plan body move", 85),
    ],
)
def test_the_width_of_a_text(words: str, pixels: float) -> None:
    assert pixels <= width_of(words) <= 1.25 * pixels + 4
