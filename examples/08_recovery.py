"""A task fails, and an exception handler in another module retries it with new data.

Output::

    lift to 0.2: hit a rock at 0.3
    lift to 0.4: clear
    done
"""

from tca_module import Command, ExceptionHandler, Failure, Module, Task, connect
from tca_module.testing import LocalCentral

LIFT = Command("lift leg", float)
COLLISION = Failure("terrain collision", float)  # the height of the obstacle
HIGHER = ExceptionHandler("lift it higher", float)

legs = Module("legs")
expert = Module("expert")


@legs.handles(LIFT)
def lift(_: Task, height: float) -> None:
    if height < 0.3:
        print(f"lift to {height}: hit a rock at 0.3")
        raise COLLISION(0.3)
    print(f"lift to {height}: clear")


@expert.handles(HIGHER)
def higher(task: Task, rock: float) -> None:
    trouble = task.trouble
    if trouble.attempts > 2:
        raise trouble.reissue()  # the search for an exception handler continues above
    trouble.failing.retry(LIFT, rock + 0.1)


if __name__ == "__main__":
    with LocalCentral() as central:
        legs.central = expert.central = central
        with legs.running(), expert.running(), connect("user", central) as user:
            user.on_failure(COLLISION, HIGHER, of=LIFT)
            print(user.command(LIFT, 0.2).wait(timeout=5))
