"""Decisions about matrices that rounding, and with it the processor, has no part in."""
