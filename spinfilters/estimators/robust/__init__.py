"""Robust losses and rejection of outliers."""
