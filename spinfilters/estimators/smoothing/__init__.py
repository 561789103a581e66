"""A smoother on the filters' own models: everything that was measured at once, or a window of it that slides along."""
