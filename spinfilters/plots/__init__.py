"""Figures, readable without the text."""
