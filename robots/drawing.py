"""Shapes of the world in SVG pictures of robots."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tca_tools.drawing.svg import text

Place = Sequence[float]


@dataclass(frozen=True, slots=True)
class View:
    """A part of a picture in which y points up.

    Lengths are in the world's unit, which is *scale* pixels long. The world's origin is *left*
    pixels from the left and *zero* pixels from the top. Coordinates have *digits* decimals. The
    look of a shape is a class of the picture's style. *more* are further SVG attributes by name.
    """

    left: float
    zero: float
    scale: float
    digits: int = 1

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixels of a place."""
        return self.left + x * self.scale, self.zero - y * self.scale

    def line(self, look: str, places: Iterable[Place], **more: object) -> str:
        """Return a line through the places."""
        return f'<polyline class="{look}" points="{self._points(places)}"{attributes(more)}/>'

    def shape(self, look: str, places: Iterable[Place], **more: object) -> str:
        """Return a polygon with these corners."""
        return f'<polygon class="{look}" points="{self._points(places)}"{attributes(more)}/>'

    def box(self, look: str, corner: Place, width: float, height: float, **more: object) -> str:
        """Return a rectangle, given by its lower left corner."""
        x, y = self.at(corner[0], corner[1] + height)
        size = self._pixels(x=x, y=y, width=width * self.scale, height=height * self.scale)
        return f'<rect class="{look}"{size}{attributes(more)}/>'

    def disc(self, look: str, centre: Place, radius: float, **more: object) -> str:
        """Return a circle."""
        x, y = self.at(centre[0], centre[1])
        size = self._pixels(cx=x, cy=y, r=radius * self.scale)
        return f'<circle class="{look}"{size}{attributes(more)}/>'

    def words(
        self, words: str, place: Place, right: float = 0.0, down: float = 0.0, **more: object
    ) -> str:
        """Return a text, placed *right* and *down* pixels beside a place."""
        x, y = self.at(place[0], place[1])
        return (
            f"<text{self._pixels(x=x + right, y=y + down)}{attributes(more)}>{text(words)}</text>"
        )

    def _points(self, places: Iterable[Place]) -> str:
        pixels = (self.at(place[0], place[1]) for place in places)
        return " ".join(f"{x:.{self.digits}f},{y:.{self.digits}f}" for x, y in pixels)

    def _pixels(self, **values: float) -> str:
        return attributes({name: f"{value:.{self.digits}f}" for name, value in values.items()})


def attributes(values: dict[str, object]) -> str:
    """Format SVG attributes. A ``_`` stands for ``-``; a last ``_`` is dropped (``class_``)."""
    return "".join(
        f' {name.rstrip("_").replace("_", "-")}="{value}"' for name, value in values.items()
    )
