"""Filter and smoother side by side on measurements as they arrive."""
