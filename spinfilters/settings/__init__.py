"""Settings of a run, read from and written to TOML."""
