"""An asyncio program shares one client among its tasks, and a module's handler runs on its loop.

Output::

    heights: [0.0, 0.5, 1.0, 1.5]
    seen 1
    seen 2
    done: 2 places
    lock: True
    given up
"""

import asyncio

from tca_module import AsyncTask, Command, Module, Query, Task, aconnect

HEIGHT = Query("height", int, reply=float)
SURVEY = Command("survey", int, result=str, progress=int)
NEVER = Query("never", reply=int)

hills, eyes = Module("hills", capacity=4), Module("eyes")
places: asyncio.Queue[int] = asyncio.Queue()  # belongs to the loop, and so does the handler


@hills.handles(HEIGHT)
def height(_: Task, x: int) -> float:
    return x * 0.5


@hills.handles(NEVER, resource="dark side")
async def never(_: Task) -> int:
    await asyncio.Event().wait()
    return 0


@eyes.handles_on_loop(SURVEY)
async def survey(task: AsyncTask, number: int) -> str:
    for _ in range(number):
        place = await places.get()
        await task.query(HEIGHT, place)
        await task.report(place)
    return f"{number} places"


async def main() -> None:
    async with eyes.running_async(), aconnect("user") as user:
        heights = await asyncio.gather(*(user.query(HEIGHT, x) for x in range(4)))
        print("heights:", heights)

        surveying = await user.command(SURVEY, 2)
        async with surveying.progress(int) as seen:
            for place in (1, 2):
                places.put_nowait(place)
                print("seen", await anext(seen))
        print("done:", await surveying.result(timeout=5))

        async with user.lock("hills", timeout=5) as claim:
            print("lock:", claim.held)

        try:
            async with asyncio.timeout(0.1):
                await user.query(NEVER)
        except TimeoutError:
            print("given up")


if __name__ == "__main__":
    with hills.running():
        asyncio.run(main())
