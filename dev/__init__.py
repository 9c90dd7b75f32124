"""For developers only: benchmarks, fuzzing, invariants, scripts. No wheel contains this."""
