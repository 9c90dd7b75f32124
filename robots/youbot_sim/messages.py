"""The messages between the robot's modules. No module needs to know the handler of a message."""

from robots.youbot_sim.vocabulary import Drive, JointReadings, Motion, Move
from tca_module import Command, Failure, Query, Variable

# Messages of the coordinator. Progress is the part of the way that is done, from 0 to 1.
MOVE_BASE = Command("move base", Move, progress=float)
MOVE_ARM = Command("move arm", Move, progress=float)
MOVE_GRIPPER = Command("move gripper", Move, progress=float)
BOX_B_FREE = Variable("box B is free", float)
"""How sure perception is that box B is free, from 0 to 1."""

UNKNOWN_POSE = Failure("unknown pose", str)
DID_NOT_ARRIVE = Failure("did not arrive", float)
"""The distance of the farthest joint from its goal."""

# Messages of the user.
CARRY_OBJECTS = Command("carry objects", int)
"""Have the robot carry this number of objects, one after the other."""

OFFER_OBJECT = Command("offer object")

# Queries to the simulator.
DRIVE = Query("drive", Drive, reply=Motion)
HALT = Query("halt", str, reply=Motion)
MEASURE = Query("measure", reply=JointReadings)
LOOK = Query("look into box B", reply=bool)
