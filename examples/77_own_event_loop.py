"""An asyncio program: its tasks share one client, and a handler runs on its event loop."""

import asyncio

from tca_module import AsyncTask, Command, Module, Query, Task, aconnect

HEIGHT = Query("height", int, reply=float)
SURVEY = Command("survey", int, result=str, progress=int)

hills, eyes = Module("hills", capacity=4), Module("eyes")


@hills.handles(HEIGHT)
def height(_: Task, x: int) -> float:
    return x * 0.5


@eyes.handles_on_loop(SURVEY)
async def survey(task: AsyncTask, places: int) -> str:
    for place in range(places):
        await task.query(HEIGHT, place)
        await task.report(place)
    return f"{places} places"


async def main() -> None:
    async with eyes.running_async(), aconnect("user") as user:
        print(await asyncio.gather(*(user.query(HEIGHT, x) for x in range(4))))
        surveying = await user.command(SURVEY, 2)
        print("surveyed:", await surveying.result(timeout=5))


if __name__ == "__main__":
    with hills.running():
        asyncio.run(main())
