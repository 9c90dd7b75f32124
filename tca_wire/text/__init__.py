"""Data as text for people, and text from people as data."""
