"""State blocks."""
