"""Task servers: definitions, parameters, runs."""
