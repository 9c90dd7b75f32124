"""A task that fails, and an exception handler, in a module of its own, that lets it try again more
carefully.

::

    $ python examples/08_recovery.py
    lift to 0.2: hit a rock at 0.3
    lift to 0.4: clear
    done
"""

from tca_module import Command, ExceptionHandler, Failure, Module, Task, connect
from tca_module.testing import LocalCentral

LIFT = Command("lift leg", float)
COLLISION = Failure("terrain collision", float)  # at which height
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
        raise trouble.reissue()  # let somebody above decide
    trouble.failing.retry(LIFT, rock + 0.1)


if __name__ == "__main__":
    with LocalCentral() as central:
        legs.central = expert.central = central
        with legs.running(), expert.running(), connect("user", central) as user:
            user.on_failure(COLLISION, HIGHER, of=LIFT)
            print(user.command(LIFT, 0.2).wait(timeout=5))
