"""Recordings whose models are wrong in one known way, a module for each part of the models."""
