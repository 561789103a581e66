"""CasADi expressions turned into numbers: the only place that knows buffers, densifying and C caches."""
