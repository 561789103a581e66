"""Filters, their start from data, and the one loop over time."""
