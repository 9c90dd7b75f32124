"""How many messages there were, how long they took and waited, and how busy the resources were."""
