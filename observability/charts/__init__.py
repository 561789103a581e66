"""Coordinates that a motion can be analysed in, one file each."""
