"""What the journal records, and its bytes."""
