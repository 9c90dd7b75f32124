"""A test of a mission on a stepped clock: ten minutes of driving take a moment."""

from concurrent.futures import ThreadPoolExecutor

from tca_behaviours.missions import Environment, Mission, PeriodicTask, Status, TaskServer
from tca_module.testing import LocalCentral


class Cart(Environment):
    place = 0


class Drive(PeriodicTask[Cart]):
    goal: int
    task_period = 1.0  # one metre a second

    def iterate(self) -> Status:
        self.env.place += 1 if self.env.place < self.goal else -1
        return Status.COMPLETED if self.env.place == self.goal else Status.RUNNING


def go_out_and_back(central: LocalCentral | None = None) -> None:
    """The mission."""
    with Mission("cart", central=central) as mission:
        mission.Drive(goal=300)
        mission.Drive(goal=10)


def test_cart_stops_before_its_start() -> None:
    cart = Cart()
    with (
        LocalCentral(stepped=True) as central,
        TaskServer("cart", cart, tasks=[Drive], central=central).running(),
        ThreadPoolExecutor() as pool,
    ):
        mission = pool.submit(go_out_and_back, central)
        while not mission.done():
            central.advance(1.0)
        mission.result()  # raises what the mission raised
        assert cart.place == 10


if __name__ == "__main__":  # pytest calls the test
    test_cart_stops_before_its_start()
    print("passed")
