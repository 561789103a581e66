"""Stereo images in, tracks of landmarks out; calibration, and a renderer of images with truth."""
