"""Estimation while measurements arrive."""
