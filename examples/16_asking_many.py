"""Ask all handlers of a multi-query: for the first reply, all replies in time, or one by one."""

import threading

from tca_module import Failure, Module, MultiQuery, Task

BID = MultiQuery("bid", str, reply=int)
BUSY = Failure("busy", str)

arms = [Module(f"arm {number}") for number in (1, 2, 3)]
asker = Module("asker")
may_reply = threading.Event()


@arms[0].handles(BID)
def quick(_: Task, job: str) -> int:
    return len(job)


@arms[1].handles(BID)
def refuses(_: Task, job: str) -> int:
    raise BUSY(job)  # a failure gives no reply


@arms[2].handles(BID)
def thinks(_: Task, job: str) -> int:
    may_reply.wait(10)  # late, until the last call below
    return 2 * len(job)


if __name__ == "__main__":
    with arms[0].running(), arms[1].running(), arms[2].running(), asker.running():
        print("the first bid:", asker.multi_query(BID, "dig", maximum=1))
        # Waits the whole second, because the third arm does not reply.
        print("all in time:", asker.multi_query(BID, "dig", timeout=1.0))
        for bid in asker.multi_query_send(BID, "dig", timeout=10):
            print("bid:", bid)
            may_reply.set()
