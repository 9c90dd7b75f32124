"""A journal as text, its facts as plain values, and the removal of old runs."""
