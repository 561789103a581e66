"""Simulated motions and measurements."""
