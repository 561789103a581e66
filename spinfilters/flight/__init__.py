"""Stretches of free flight in a recording, found without knowledge of the body."""
