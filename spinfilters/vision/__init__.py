"""Stereo images: features, matches and tracks of landmarks, calibration, and the dense model of the body."""
