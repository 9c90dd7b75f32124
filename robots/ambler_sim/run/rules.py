"""What must hold of every walk, for ``tca check walk/journal robots/ambler_sim/run/rules.py``.

That a stability check precedes and a footfall check follows every move, and that no move is handled while the scanner
holds the controller, follows from the rules that ``tca check`` has for wiretaps and locks.
"""

PROPERTIES = [
    "at most 1 planned ahead of take steps",
    "at most 1 handled of move leg",
    "at most 1 handled of move body",
    "at most 1 handled of acquire image",
    "move leg begun before move body achieved",
]
