"""Measurement logs, data sets and truths; their files."""
