"""The nonlinear least-squares problem."""
