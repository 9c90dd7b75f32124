"""What the robot's modules say to each other. Nobody needs to know who handles them."""

from robots.youbot_sim.vocabulary import Drive, JointReadings, Motion, Move
from tca_module import Command, Failure, Query, Variable

# What a coordinator uses. Progress is the part of the way that is done, from 0 to 1.
MOVE_BASE = Command("move base", Move, progress=float)
MOVE_ARM = Command("move arm", Move, progress=float)
MOVE_GRIPPER = Command("move gripper", Move, progress=float)
BOX_B_FREE = Variable("box B is free", float)
"""How sure perception is of it, from 0 to 1."""

UNKNOWN_POSE = Failure("unknown pose", str)
DID_NOT_ARRIVE = Failure("did not arrive", float)
"""By how much the farthest joint missed its goal."""

# What the user does.
CARRY_OBJECTS = Command("carry objects", int)
"""Have the robot carry so many, one after the other."""

OFFER_OBJECT = Command("offer object")

# What the simulator answers.
DRIVE = Query("drive", Drive, reply=Motion)
HALT = Query("halt", str, reply=Motion)
MEASURE = Query("measure", reply=JointReadings)
LOOK = Query("look into box B", reply=bool)
