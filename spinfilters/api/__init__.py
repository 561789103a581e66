"""The Python interface: what `import spinfilters` offers."""
