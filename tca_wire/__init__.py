"""The shared language of modules and central: messages, formats, points, constraints, journal
records.
"""
