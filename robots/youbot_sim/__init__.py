"""A mobile manipulator like KUKA's youBot, which carries objects to boxes: the case study of
preview coordination.
"""
