"""What is raised for properties that make no sense."""


class BadProperty(ValueError):
    """What was given is no property, or no predicate; its message says what, which and what to do."""
