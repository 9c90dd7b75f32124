"""Vision: finds cups in the ceiling camera's pictures, and follows them from picture to picture."""

from contextlib import suppress

from robots.office_sim.messages import CAMERA, CUPS_IN_VIEW
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Cup, Spot
from tca_module import Callback, Module, Stopped, Task

PERIOD = 0.5
"""Seconds between two pictures."""

NEAR = 0.15
"""The distance (m) up to which objects in two pictures are the same cup."""

PATIENCE = 3
"""A cup is out of view when it is missing in this number of successive pictures: the camera
overlooks some cups.
"""


class CupTracks:
    """The cups in view, by number."""

    def __init__(self) -> None:
        self._cups: dict[int, Cup] = {}
        self._missed: dict[int, int] = {}
        self._last = 0

    def see(self, spots: list[Spot]) -> None:
        """Process a picture."""
        new_spots = list(spots)
        for number, cup in list(self._cups.items()):
            seen = [spot for spot in new_spots if spot.to(cup.spot) <= NEAR]
            for spot in seen:
                new_spots.remove(spot)
            self._missed[number] = 0 if seen else self._missed[number] + 1
            if self._missed[number] >= PATIENCE:
                del self._cups[number], self._missed[number]
        for spot in new_spots:
            self._last += 1
            self._cups[self._last], self._missed[self._last] = Cup(self._last, spot), 0

    @property
    def cups(self) -> list[Cup]:
        """The cups in view, oldest first."""
        return list(self._cups.values())


def make_module(pace: float) -> Module:
    """Make the module."""
    vision, tracks = Module("vision"), CupTracks()

    @vision.every(PERIOD / pace, resource="vision")
    def process_picture(callback: Callback) -> None:
        with suppress(Stopped):  # the module is ending
            tracks.see(callback.query(CAMERA))

    @vision.handles(CUPS_IN_VIEW)
    def cups_in_view(_: Task) -> list[Cup]:
        return tracks.cups

    return vision


if __name__ == "__main__":
    run(make_module)
