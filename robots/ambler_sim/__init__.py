"""A simulated Ambler: CMU's six-legged walking rover of 1990."""
