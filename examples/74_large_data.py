"""Send images as numpy arrays. A message has at most 8 MiB."""

import numpy as np
from numpy.typing import NDArray

from tca_module import BadData, Module, Query, QueryFailed, Task, connect

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
            user.query(BRIGHTNESS, np.zeros((3000, 3000), np.uint8))  # 9 MB: too large
        except BadData as error:
            print(error)
        try:
            user.query(LOOK, 3000)  # the reply is too large
        except QueryFailed as error:
            print(error)
