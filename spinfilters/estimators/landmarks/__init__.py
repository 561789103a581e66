"""Filters that hold the landmarks in their state."""
