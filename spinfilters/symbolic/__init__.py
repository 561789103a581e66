"""CasADi expressions turned into numbers: the only place that knows buffers, densifying and C caches."""

from spinfilters.symbolic.compiled import Compiled

__all__ = ["Compiled"]
