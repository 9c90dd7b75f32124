"""Send a message only if a module handles it now: for an optional part of the robot."""

from tca_module import Command, Module, Query, Task, connect

BLINK = Command("blink", str)
FORECAST = Query("forecast", reply=str)

lights, weather = Module("lights"), Module("weather")


@lights.handles(BLINK)
def blink(_: Task, colour: str) -> None:
    print("blinking", colour)


@weather.handles(FORECAST)
def forecast(_: Task) -> str:
    return "dry"


if __name__ == "__main__":
    with connect("user") as user:
        print(user.execute_if_handled(BLINK, "red"), user.execute_if_handled(FORECAST))
        with lights.running(), weather.running():
            blinking = user.execute_if_handled(BLINK, "green")  # the result of command()
            print(blinking and blinking.wait(timeout=10), user.execute_if_handled(FORECAST))
