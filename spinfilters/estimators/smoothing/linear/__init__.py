"""Elimination, solution and marginals of the linear problem."""
