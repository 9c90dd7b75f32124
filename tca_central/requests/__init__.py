"""The requests of modules: one function each."""
