"""Data as text that people read, and text that people type as data."""
