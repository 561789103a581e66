"""Readers of raw data, one file each: a folder of scans in, a data set of measurements out."""
