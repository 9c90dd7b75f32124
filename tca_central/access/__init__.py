"""The permissions that requests need."""
