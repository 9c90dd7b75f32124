"""For developers only: benchmarks, attacks with random bytes, scripts. No wheel has this."""
