"""A mobile manipulator like KUKA's youBot that carries objects to boxes: the case study of preview
coordination.
"""
