"""Poses and maps from tracks of landmarks, from which cameras begin."""
