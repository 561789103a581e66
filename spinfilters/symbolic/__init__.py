"""CasADi expressions turned into numbers: the only place that knows buffers, densifying and C caches."""

from spinfilters.symbolic.compiled import Compiled
from spinfilters.symbolic.vectorised import Vectorised, VectorisedScan
from spinfilters.symbolic.working_time import building, built_property, working_seconds

__all__ = ["Compiled", "Vectorised", "VectorisedScan", "building", "built_property", "working_seconds"]
