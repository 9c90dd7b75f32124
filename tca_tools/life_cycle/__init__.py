"""``tca lifecycle``: life cycles of tasks as tables and diagrams."""
