"""The laser scanner and its image queue: takes range images while the machine holds still, and
keeps the last ones.

The scanner locks the controller while it takes an image, so that no move blurs the image (paper,
"Resource Management").
"""

from collections import deque

import numpy as np

from robots.ambler_sim.messages import ACQUIRE_IMAGE, BAD_IMAGE, IMAGES, NO_IMAGE, RANGES
from robots.ambler_sim.planning.elevation import points_of
from robots.ambler_sim.vocabulary import Image, Scan
from tca_module import Module, Task

IMAGES_KEPT = 6
"""The number of images kept. A restarted mapper builds its map from them."""

LEAST_POINTS = 600
"""The least number of points in a good image; there are 6144 rays."""

FARTHEST_BELOW = 8.0
"""How far (m) visible ground may lie below the body."""

scanner = Module("scanner")


memory: deque[Image] = deque(maxlen=IMAGES_KEPT)
"""The last images, oldest first."""


@scanner.handles(ACQUIRE_IMAGE)
def acquire_image(task: Task, number: int) -> None:
    """Take an image before the footstep with this number."""
    with task.lock("controller", "controller"):
        scan = task.query(RANGES)
    if not scan.points:
        raise NO_IMAGE(number, f"the scanner gave no image before footstep {number}")
    if fault := fault_of(scan):
        raise BAD_IMAGE(number, f"the image before footstep {number} {fault}")
    memory.append(Image(task.id, scan))


@scanner.handles(IMAGES, resource="image queue")
def images(_: Task, after: int) -> tuple[Image, ...]:
    """Return the images after the one with this number."""
    return tuple(image for image in tuple(memory) if image.number > after)


def fault_of(scan: Scan) -> str:
    """Describe why an image can't show ground; "" if it can."""
    points = points_of(scan)
    if len(points) < LEAST_POINTS:
        return f"has only {len(points)} points"
    below = scan.stance.pose.height - points[:, 2]
    share = float(np.mean((below < 0.0) | (below > FARTHEST_BELOW)))
    return f"has {share:.0%} of its points where no ground can be" if share > 0.05 else ""


if __name__ == "__main__":
    scanner.run()
