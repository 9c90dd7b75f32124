"""A robot that keeps the floor of a lab free of cups."""
