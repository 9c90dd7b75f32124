"""A run's inputs and images in a replicated log, so that central may move to another machine."""
