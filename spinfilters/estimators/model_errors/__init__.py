"""Score tests of a smoothing problem's solution against alternatives of its models."""
