"""Studies and benchmarks: everything that measures the library rather than belongs to it."""
