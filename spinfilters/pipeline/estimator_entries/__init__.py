"""One file per estimator of a comparison."""
