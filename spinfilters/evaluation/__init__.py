"""Errors, NEES and NIS with their bands."""
