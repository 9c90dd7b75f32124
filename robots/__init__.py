"""Robots made with TCA."""
