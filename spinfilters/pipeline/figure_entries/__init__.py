"""One file per figure of a run."""
