"""Golden runs: the same commands before and after a change that is meant to change no number."""
