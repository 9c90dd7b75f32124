"""Send images as numpy arrays. They stay in shared memory, and arrive read-only."""

import numpy as np
from numpy.typing import NDArray

from tca_module import Module, Query, Task, connect

Image = NDArray[np.uint8]
LOOK = Query("look", int, reply=Image)
BRIGHTNESS = Query("brightness", Image, reply=float)

camera, vision = Module("camera"), Module("vision")


@camera.handles(LOOK)
def look(_: Task, size: int) -> Image:
    return np.full((size, size), 7, dtype=np.uint8)


@vision.handles(BRIGHTNESS)
def brightness(_: Task, image: Image) -> float:
    return float(image.mean())


if __name__ == "__main__":
    with camera.running(), vision.running(), connect("user") as user:
        image = user.query(LOOK, 2000)
        print(f"{image.nbytes:,} bytes, brightness", user.query(BRIGHTNESS, image))
        try:
            image[0, 0] = 255
        except ValueError as error:
            print(error)
        changed = image.copy()
        changed[:, :1000] = 255
        print("brightness", user.query(BRIGHTNESS, changed))
