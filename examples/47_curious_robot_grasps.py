"""A coordinator passes on feedback and corrections while a robot grasps.

The second case study of Lütkebohle et al., "The Task-State Pattern" (figure 14).
"""

import asyncio
import threading

from tca_module import Command, Module, Rejected, SentTask, Task, connect
from tca_module.testing import LocalCentral

GRASP = Command("grasp", int, result=str, progress=str)
REACH = Command("reach", int, result=str, progress=str)
coordinator, arm = Module("coordinator"), Module("arm")
has_arrived = threading.Event()


@coordinator.handles(GRASP, takes=["update"])
async def grasp(task: Task, place: int) -> str:
    hand = task.command(REACH, place)
    corrections = asyncio.create_task(forward_updates(task, hand))
    async for feedback in hand.progress(str):
        task.report(feedback)
    corrections.cancel()
    return str(await hand)


async def forward_updates(task: Task, hand: SentTask[str]) -> None:
    async for request in task.requests():
        try:
            await hand.update_send(request.goal)
            request.accept()
        except Rejected as refused:
            request.reject(refused.reason)


@arm.handles(REACH, takes=["update"])
def reach(task: Task, place: int) -> str:
    task.report(f"moving to {place}")
    while not has_arrived.is_set():
        request = task.wait_for_request(0.02)
        if request and request.goal > 50:
            request.reject(f"{request.goal} is out of reach")
        elif request and request.accept():
            place = request.goal
            task.report(f"moving to {place}")
    return f"grasped at {place}"


if __name__ == "__main__":
    with LocalCentral() as central:
        coordinator.central = arm.central = central
        with coordinator.running(), arm.running(), connect("dialog", central) as dialog:
            grasping = dialog.command(GRASP, 10)
            feedback = grasping.progress(str, timeout=5)
            for correction in (7, 99):
                print(next(feedback))
                try:
                    grasping.update(correction, timeout=5)
                except Rejected as refused:
                    print(refused.reason)
            has_arrived.set()
            print(grasping.result(5))
