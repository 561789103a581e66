"""State layout, Gaussian beliefs and status."""
