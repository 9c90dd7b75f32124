"""A test of a task server on a stepped clock: the door opens for five minutes in a moment."""

from tca_behaviours.missions import Environment, OnceTask, TaskServer, parameter
from tca_module import connect
from tca_module.testing import LocalCentral


class Oven(Environment):
    door_is_open = False


class OpenDoor(OnceTask[Oven]):
    """Open the door for a while."""

    seconds: float = parameter(300.0, "How long", minimum=0)

    def iterate(self) -> None:
        with self.env.lock:
            self.env.door_is_open = True
        self.sleep(self.seconds)

    def terminate(self) -> None:
        self.env.door_is_open = False


def test_door_closes_after_its_time() -> None:
    oven = Oven()
    with LocalCentral(stepped=True) as central:
        server = TaskServer("oven", oven, tasks=[OpenDoor], central=central)
        with server.running(), connect("tester", central) as tester:
            door = server.definitions["OpenDoor"]
            sent = tester.command(door.message, door.parameters(seconds=200.0))
            central.advance(199.0)
            assert oven.door_is_open
            central.advance(2.0)
            assert not oven.door_is_open
            print(sent.result())


if __name__ == "__main__":  # pytest calls the test
    test_door_closes_after_its_time()
