"""Speed, as ratios of interleaved medians measured in one run."""
