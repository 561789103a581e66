"""A run: settings and a data set in; estimates, verdicts and a folder out."""
