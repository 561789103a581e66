"""Sensors: one file each, found by the registry, and their interface."""
