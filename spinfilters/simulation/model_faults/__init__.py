"""Recordings whose models are wrong in one known way.

A module for each part of the models.
"""
