"""Lidar: simulated scans of a mesh, features and poses of point clouds, streams for the estimators."""
