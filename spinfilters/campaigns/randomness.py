"""Seeds of a run, derived from the root seed of its study."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RunSeeds:
    """Independent generators of one seed, the same for every cell."""

    motion: np.random.SeedSequence
    measurements: np.random.SeedSequence
    faults: np.random.SeedSequence
    belief: np.random.SeedSequence
    factors: np.random.SeedSequence


def run_seeds(root: int, seed: int) -> RunSeeds:
    """Generators of seed number ``seed``, that child of ``SeedSequence(root)``."""
    child = np.random.SeedSequence(root, spawn_key=(seed,))
    return RunSeeds(*child.spawn(5))


def whole_number(sequence: np.random.SeedSequence) -> int:
    """A seed sequence as a number below 2^63."""
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))
