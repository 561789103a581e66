"""The verdict on an estimate: one list of checks, and what still holds where some of them fail."""
