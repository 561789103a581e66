"""Readers of raw data, one file each.

A folder of scans in, a data set of measurements out.
"""
