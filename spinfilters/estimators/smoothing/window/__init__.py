"""Incremental smoothing over a sliding window."""
