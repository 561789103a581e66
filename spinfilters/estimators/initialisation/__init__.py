"""Initialisation from the first epochs: an initial guess from motion samples, refined by the batch smoother."""
