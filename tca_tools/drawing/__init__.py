"""What pictures are made of, and how they become files."""
