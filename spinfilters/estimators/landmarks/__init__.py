"""Landmarks that nobody knew, beside the state of a filter: their shared modes, and each one's own error."""
