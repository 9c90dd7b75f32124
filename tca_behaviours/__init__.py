"""Programming models on top of the library: missions, state machines, coordination, activities."""
