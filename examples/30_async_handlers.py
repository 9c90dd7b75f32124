"""``async def`` handlers: ask queries at the same time, and clean up when the task is killed."""

import asyncio
import time

from tca_module import Command, Goal, Module, Query, Task, TaskKilled

SURVEY, WATCH = Goal("survey"), Command("watch")
HEIGHT = Query("height", int, reply=float)

eyes, hills = Module("eyes"), Module("hills", capacity=3)


@hills.handles(HEIGHT)
def height(_: Task, x: int) -> float:
    time.sleep(0.1)
    return x * 0.5


@eyes.handles(SURVEY)
async def survey(task: Task) -> None:
    started = time.monotonic()
    # Three queries of 0.1 s each, at the same time.
    heights = await asyncio.gather(*(task.query_send(HEIGHT, x) for x in range(3)))
    order = "one by one" if time.monotonic() - started > 0.25 else "at the same time"
    print("heights:", heights, "asked", order)
    watch = task.command(WATCH)
    await asyncio.sleep(0.1)
    watch.kill("seen enough")
    try:
        await watch
    except TaskKilled as killed:
        print("watch ended:", killed.why)


@eyes.handles(WATCH, resource="camera")
async def watch(_: Task) -> None:
    try:
        await asyncio.sleep(60)
    except asyncio.CancelledError:
        print("camera off")
        raise


if __name__ == "__main__":
    with eyes.running(), hills.running():
        eyes.goal(SURVEY).wait()
