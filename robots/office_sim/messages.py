"""What the programs say to each other. Nobody needs to know who handles a message."""

from robots.office_sim.vocabulary import Approach, Cup, FloorPlan, Grasped, LabScene, Spot
from tca_module import Command, Failure, Goal, Inform, PollingMonitor, Query

REACH = 0.45
"""Metres from which the hand gets at a cup, or over the bin."""

# What is wanted.
KEEP_FLOOR_FREE = Goal("keep floor free")
"""Lasts until CALL_IT_A_DAY, and until all that it has begun is done."""
CALL_IT_A_DAY = Inform("call it a day")
COLLECT_CUP = Goal("collect cup", Cup)
NAVIGATE = Goal("navigate", Approach)

# What the robot can do.
FOLLOW_PATH = Command("follow path", list[Spot])
GRASP = Command("grasp", Cup)
DROP = Command("drop")
LET_GO = Command("let go", int)
"""Of the cup with this number, if the hand holds that; else nothing is done."""
CHARGE = Command("charge")

# What it knows.
CUPS_IN_VIEW = Query("cups in view", reply=list[Cup])
HELD_CUP: Query[None, int | None] = Query("held cup", reply=int | None)
FLOOR_PLAN = Query("floor plan", reply=FloorPlan)
ROBOT_SPOT = Query("robot spot", reply=Spot)
BATTERY = Query("battery", reply=float)
"""From 0 to 1."""

# Cups are looked for as long as the floor is to be kept free; each becomes a goal.
FIND_NEW_CUP: Query[None, Cup | None] = Query("find new cup", reply=Cup | None)
ADD_CUP = Command("add cup", Cup)
NEW_CUPS = PollingMonitor("new cups", condition=FIND_NEW_CUP, action=ADD_CUP)
LEAVE_ALONE = Inform("leave alone", int)
"""The cup with this number is not looked at for a while."""

# What goes wrong.
NO_WAY = Failure("no way", Approach)
STUCK = Failure("stuck", float)
"""So many metres away from the end of the path."""
CUP_SLIPPED = Failure("cup slipped", Cup)
NO_CUP_THERE = Failure("no cup there", Cup)
NOT_AT_CHARGER = Failure("not at charger")

# What the simulator answers; seconds are those of the programs, whatever its pace.
CAMERA = Query("camera", reply=list[Spot])
DRIVE = Query("drive", list[Spot], reply=float)
"""Seconds that it takes."""
HALT = Query("halt", reply=Spot)
"""Where the robot stands then."""
CLOSE_FINGERS = Query("close fingers", Spot, reply=Grasped)
OPEN_FINGERS = Query("open fingers", reply=bool)
"""Whether they held something."""
DOCK: Query[None, float | None] = Query("dock", reply=float | None)
"""Seconds until the battery is full; None: the charger is too far away."""
SCENE = Query("scene", reply=LabScene)

OPEN_LAB = Inform("open lab")
"""From now on the lab's time passes."""
