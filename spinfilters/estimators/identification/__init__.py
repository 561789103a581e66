"""Noise identified from the data: variance components of the smoothing problem by maximum marginal likelihood."""
