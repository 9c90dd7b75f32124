"""The whole state of central as bytes, and central from such bytes: for going on after a
restart.
"""
