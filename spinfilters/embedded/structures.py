"""The filter's C structures for ctypes."""

import ctypes
from functools import cache

from spinfilters.embedded.embedded_options import EmbedOptions

STATUS = ("ok", "refused", "turns too far in a step", "would not be finite", "invalid argument")
USED, OUTSIDE, BEHIND, NEW, NOT_TOLD = range(5)


@cache
def real_type(options: EmbedOptions) -> type[ctypes.c_float] | type[ctypes.c_double]:
    """ctypes type of ``sf_real``."""
    return ctypes.c_double if options.real == "double" else ctypes.c_float


@cache
def filter_type(options: EmbedOptions) -> type[ctypes.Structure]:
    """ctypes structure of ``sf_filter``."""
    real, n = real_type(options), options.layout.error_dim
    fields = [
        ("x", real * options.layout.mean_dim),
        ("u", real * (n * (n - 1) // 2)),
        ("d", real * n),
        ("psd", real * 2),
        ("nis", real),
        *((name, ctypes.c_uint16) for name in ("dof", "used", "refused")),
    ]
    return type("Filter", (ctypes.Structure,), {"_fields_": fields})


@cache
def landmark_type(options: EmbedOptions) -> type[ctypes.Structure]:
    """ctypes structure of ``sf_landmark``."""
    real = real_type(options)
    fields = [
        ("point", real * 3),
        ("covariance", real * 6),
        ("hits", ctypes.c_uint16),
        ("wrong", ctypes.c_uint16),
    ]
    return type("Landmark", (ctypes.Structure,), {"_fields_": fields})


@cache
def observation_type(options: EmbedOptions) -> type[ctypes.Structure]:
    """ctypes structure of ``sf_observation``."""
    fields = [
        ("pixels", real_type(options) * 3),
        ("landmark", ctypes.c_uint16),
        ("outcome", ctypes.c_uint16),
    ]
    return type("Observation", (ctypes.Structure,), {"_fields_": fields})
