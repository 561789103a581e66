"""Poses and maps from feature tracks."""
