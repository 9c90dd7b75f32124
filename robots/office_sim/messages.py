"""The messages between the programs. No program needs to know the handler of a message."""

from robots.office_sim.vocabulary import Approach, Cup, FloorPlan, Grasped, LabScene, Spot
from tca_module import Command, Failure, Goal, Inform, PollingMonitor, Query

REACH = 0.45
"""The distance (m) at which the hand can reach a cup or the bin."""

# Goals.
KEEP_FLOOR_FREE = Goal("keep floor free")
"""The goal lasts until CALL_IT_A_DAY has come and all goals under it are done."""
CALL_IT_A_DAY = Inform("call it a day")
COLLECT_CUP = Goal("collect cup", Cup)
NAVIGATE = Goal("navigate", Approach)

# Actions of the robot.
FOLLOW_PATH = Command("follow path", list[Spot])
GRASP = Command("grasp", Cup)
DROP = Command("drop")
LET_GO = Command("let go", int)
"""Lets go of the cup with this number; does nothing if the hand does not hold it."""
CHARGE = Command("charge")

# Knowledge of the robot.
CUPS_IN_VIEW = Query("cups in view", reply=list[Cup])
HELD_CUP: Query[None, int | None] = Query("held cup", reply=int | None)
FLOOR_PLAN = Query("floor plan", reply=FloorPlan)
ROBOT_SPOT = Query("robot spot", reply=Spot)
BATTERY = Query("battery", reply=float)
"""From 0 to 1."""

# While the floor is kept free, a monitor searches for cups; each becomes a goal.
FIND_NEW_CUP: Query[None, Cup | None] = Query("find new cup", reply=Cup | None)
ADD_CUP = Command("add cup", Cup)
NEW_CUPS = PollingMonitor("new cups", condition=FIND_NEW_CUP, action=ADD_CUP)
LEAVE_ALONE = Inform("leave alone", int)
"""The cup with this number is ignored for a while."""

# Failures.
NO_WAY = Failure("no way", Approach)
STUCK = Failure("stuck", float)
"""Its data is the distance (m) from the end of the path."""
CUP_SLIPPED = Failure("cup slipped", Cup)
NO_CUP_THERE = Failure("no cup there", Cup)
NOT_AT_CHARGER = Failure("not at charger")

# Queries to the simulator. Its replies are in seconds of the programs' time, at any pace.
CAMERA = Query("camera", reply=list[Spot])
DRIVE = Query("drive", list[Spot], reply=float)
"""Starts the drive. The reply is its duration in seconds."""
HALT = Query("halt", reply=Spot)
"""Stops the robot. The reply is its place."""
CLOSE_FINGERS = Query("close fingers", Spot, reply=Grasped)
OPEN_FINGERS = Query("open fingers", reply=bool)
"""Opens the fingers. The reply is whether they held something."""
DOCK: Query[None, float | None] = Query("dock", reply=float | None)
"""Starts charging. The reply is the seconds until full; None if the charger is too far away."""
SCENE = Query("scene", reply=LabScene)

OPEN_LAB = Inform("open lab")
"""Starts the lab's time."""
