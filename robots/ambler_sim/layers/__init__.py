"""Reactive layers: each file is a program that adds wiretaps, monitors and exception handlers."""
