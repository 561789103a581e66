"""Recursive filters in square-root form."""
