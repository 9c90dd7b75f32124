"""What messages and tasks cost here, beside what else moves messages."""
