"""Smoothing on the filters' own models, in batch or over a sliding window."""
