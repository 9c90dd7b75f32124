"""The contestants that need nothing but us: ZeroMQ alone, and central."""
