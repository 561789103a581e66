"""The start of filters that hold landmarks: their first frames, smoothed with all landmarks as unknowns."""
