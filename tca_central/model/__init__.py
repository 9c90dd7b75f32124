"""What central knows: who is there, messages, tasks, resources, variables and the clock. Structure, no rules."""
