"""Cameras, triangulation and absolute orientation."""
