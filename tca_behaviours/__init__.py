"""Programming models on top of the library: missions, state machines of tasks, preview
coordination, activities.
"""
