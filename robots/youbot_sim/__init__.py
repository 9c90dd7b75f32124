"""A mobile manipulator like KUKA's youBot that carries objects, to study preview coordination."""
