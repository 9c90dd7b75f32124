"""The language of modules and central: messages, formats, points, constraints, journal facts."""
