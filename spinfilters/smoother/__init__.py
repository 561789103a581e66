"""The smoother: a nonlinear least-squares problem of motion and landmarks, in a batch or a sliding window."""
