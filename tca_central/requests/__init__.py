"""What modules ask for: a function for each message."""
