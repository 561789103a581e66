"""LAPACK's routines for double precision, as SciPy wraps them; see there for arguments and results."""

from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs

NAMES = ("geqrf", "potrf", "pstrf", "tpqrt", "trtri", "trtrs")
dgeqrf: Any
dpotrf: Any
dpstrf: Any
dtpqrt: Any
dtrtri: Any
dtrtrs: Any
dgeqrf, dpotrf, dpstrf, dtpqrt, dtrtri, dtrtrs = get_lapack_funcs(NAMES, dtype=np.float64)
