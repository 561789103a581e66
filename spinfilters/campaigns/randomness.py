"""Seeds of a run: children of the study's root by their number alone, so that results do not depend on who runs what."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RunSeeds:
    """Independent generators of one seed of a study: every cell has the same, so that cells are compared on the same draws."""

    motion: np.random.SeedSequence
    measurements: np.random.SeedSequence
    faults: np.random.SeedSequence
    belief: np.random.SeedSequence
    factors: np.random.SeedSequence


def run_seeds(root: int, seed: int) -> RunSeeds:
    """Those of the seed of a number: child ``seed`` of ``SeedSequence(root)``."""
    child = np.random.SeedSequence(root, spawn_key=(seed,))
    return RunSeeds(*child.spawn(5))


def whole_number(sequence: np.random.SeedSequence) -> int:
    """A seed sequence as a number below 2^63."""
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))
