"""Model errors, a file each."""
