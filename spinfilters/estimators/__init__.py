"""Filters, smoothers, their initialisation, and the one loop over time."""
