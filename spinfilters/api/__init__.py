"""The Python interface: what `import spinfilters` offers, and a run as one file for another tool."""
