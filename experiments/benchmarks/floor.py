"""The floor under an iteration of a smoother: a loop in C of as many multiply-adds as its two largest parts need at least.

These are the Schur complement of the landmarks and the Cholesky factor of what is left. Of each landmark seen in n frames, every
pair of frames has a product of a 6 x 3 and a 3 x 6 block: 108 multiply-adds for each of n (n + 1) / 2 pairs. An observation of
three rows adds 6 x 6 to its pose, 3 x 3 to its landmark and 3 x 6 between both, so 189. A dense factor of N = 6 frames + 8 unknowns
takes N^3 / 6. At 115 frames of the common workload these are 86 million multiply-adds, 172 Mflop. The loop adds multiples of rows
in the first cache, c += a b, a vector of this machine at a time. Left out are linearising, the elimination of velocities, and back
substitution, which every iteration needs as well.
"""

import ctypes
from functools import cache
from statistics import median
from typing import Final

import numpy as np

from experiments.benchmarks.smoother_workload import Workload
from experiments.benchmarks.stopwatch import now
from spinfilters.core.c_library import KERNEL_FLAGS, LANES, Signature, load_text, with_signatures
from spinfilters.core.errors import InputError
from spinfilters.core.large_arrays import pooled_zeros

TEXT: Final = (
    f"enum {{ LANES = {LANES} }};"
    """
typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));

/* c [columns] += a[k] * b[k] [columns] for all rows k, as often as wanted. */
void multiply_adds(long long rounds, long long rows, long long columns, const double* a, const double* b, double* c) {
  for (long long round = 0; round < rounds; ++round)
    for (long long k = 0; k < rows; ++k) {
      const lanes factor = a[k] - (lanes){0};
      for (long long j = 0; j < columns; j += LANES) *(lanes*)(c + j) += factor * *(const lanes*)(b + k * columns + j);
    }
}
"""
)
ROWS: Final = 6
COLUMNS: Final = 512
"""28 kB with the sums: they stay in the first cache, and a sum is stored long before it is read again."""
PAIR: Final = 108
OBSERVATION: Final = 189
CONSTANTS: Final = 8


def least_multiply_adds(workload: Workload) -> int:
    """Multiply-adds of the landmarks' elimination and of the dense factorisation."""
    seen = np.bincount(workload.observations.landmark).astype(np.int64)
    unknowns = 6 * len(workload.timeline) + CONSTANTS
    pairs = int((seen * (seen + 1) // 2).sum())
    return PAIR * pairs + OBSERVATION * int(seen.sum()) + unknowns**3 // 6


def floor_seconds(multiply_adds: int, runs: int) -> float:
    """Median time of the loop over so many multiply-adds, s.

    Raises
    ------
    InputError: there is no C compiler.
    """
    library = _library()
    if library is None:
        raise InputError("the floor is a loop in C; install a C compiler")
    rounds = -(-multiply_adds // (ROWS * COLUMNS))
    a, b, c = np.full(ROWS, 1e-9), pooled_zeros(ROWS, COLUMNS), pooled_zeros(COLUMNS)
    b += 1.0
    places = [array.ctypes.data for array in (a, b, c)]
    times = []
    for _ in range(runs):
        begin = now()
        library.multiply_adds(rounds, ROWS, COLUMNS, *places)
        times.append(now() - begin)
    return median(times) * multiply_adds / (rounds * ROWS * COLUMNS)


@cache
def _library() -> ctypes.PyDLL | None:
    return with_signatures(
        load_text("benchmark_floor", TEXT, KERNEL_FLAGS), {"multiply_adds": Signature("iiippp", None)}
    )
