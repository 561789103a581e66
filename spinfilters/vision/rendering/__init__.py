"""Rendered stereo images of a moving body, with truth."""
