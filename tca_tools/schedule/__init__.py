"""What the agents of a coordinator did when: several runs one above the other."""
