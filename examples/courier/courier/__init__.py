"""A robot of five programs that carries parcels from room to room."""
