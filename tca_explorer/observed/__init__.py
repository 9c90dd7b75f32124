"""What is known of a run from the facts that central records."""
