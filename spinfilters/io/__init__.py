"""Recordings and data sets as files and as arrays; knows no estimator."""
