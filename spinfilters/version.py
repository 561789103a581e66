"""Version of this package, which runs, checkpoints and campaigns record."""

__version__ = "0.1.0"
