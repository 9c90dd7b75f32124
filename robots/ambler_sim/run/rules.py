"""What must hold of every walk, for ``tca check walk/journal robots/ambler_sim/run/rules.py``.

The rules that ``tca check`` has for wiretaps and locks judge those that there are: whether each move was checked at all
is in the figures of the walk.
"""

PROPERTIES = [
    "at most 1 planned ahead of take steps",
    "at most 1 handled of move leg",
    "at most 1 handled of move body",
    "at most 1 handled of acquire image",
    "move leg begun before move body achieved",
]
