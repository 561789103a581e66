"""Measurements as arrays, and the files they come from."""
