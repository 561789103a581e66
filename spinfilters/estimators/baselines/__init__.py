"""Estimators of other packages, to compare with."""
