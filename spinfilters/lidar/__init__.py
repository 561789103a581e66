"""Lidar scans in, poses or points of the body out."""
