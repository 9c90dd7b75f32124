"""A journal as text, and facts as plain values."""
