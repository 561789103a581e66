"""Landmarks of unknown position in a filter: shared error modes and own errors."""
