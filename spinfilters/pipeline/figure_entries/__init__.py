"""Figures of a run, in modules with a ``FIGURE`` or several."""
