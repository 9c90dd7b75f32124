"""The journal's facts, and its bytes."""
