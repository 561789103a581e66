"""Errors, NEES and NIS with their bands, bounds, tests of a filter's noise, and the one table of metrics."""
