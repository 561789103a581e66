"""A comparison step by step: set up, estimate, assess, draw."""
