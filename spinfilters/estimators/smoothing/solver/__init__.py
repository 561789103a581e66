"""Iterations to the minimum: schedules and step rules."""
