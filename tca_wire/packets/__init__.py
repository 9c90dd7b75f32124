"""The headers that modules and central exchange, and their bytes."""
