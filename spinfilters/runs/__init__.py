"""The run folder: records, checkpoints, summary, fingerprint."""
