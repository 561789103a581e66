"""Motions over 100 revolutions by integration of 38 digits, kept beside this file: ``python -m tests.core.reference_motions``."""

import json
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from tests.core.taylor_reference import ReferenceMotion, reference_motion

BODIES: Final = {
    "generic, about the minor axis": ([3.0, 2.0, 1.5], [0.3, 0.5, 0.4]),
    "generic, about the major axis, other order": ([2.0, 1.5, 3.0], [-0.1, 0.4, 0.9]),
    "axisymmetric": ([2.0, 2.0, 1.0], [0.3, 0.4, -0.5]),
    "almost axisymmetric, slow polhode": ([2.0, 2.0 - 1e-15, 1.0], [0.3, 0.4, 1e-9]),
    "almost a sphere": ([1.0, 1.0 + 1e-12, 1.0 - 1e-12], [0.3, 0.4, 0.5]),
    "almost a spin about the intermediate axis": ([3.0, 2.0, 1.5], [1e-9, 1.0, 1e-10]),
    "needle": ([1.0, 1.0, 1e-3], [0.3, 0.4, 0.5]),
}
"""Moments of inertia and first rate, rad/s."""
ATTITUDE0: Final = np.array([0.5, -0.1, 0.7, -0.5])
REVOLUTIONS: Final = 100.0
FILE: Final = Path(__file__).with_suffix(".json")


def times_of(rate: list[float], revolutions: float = REVOLUTIONS) -> Float[np.ndarray, " n"]:
    """Twelve times from 0 on, s."""
    return np.linspace(0.0, revolutions * 2.0 * np.pi / float(np.linalg.norm(rate)), 12)


def integrated(name: str, count: int) -> ReferenceMotion:
    """A body's motion at its first ``count`` times; a prefix of the whole, bit for bit."""
    moments, rate = BODIES[name]
    return reference_motion(np.array(moments), np.array(rate), times_of(rate)[:count], ATTITUDE0)


def kept(name: str) -> ReferenceMotion:
    """A body's motion as the file has it."""
    motion = json.loads(FILE.read_text())[name]
    return ReferenceMotion(np.array(motion["attitude"]), np.array(motion["rate"]))


def main() -> None:
    """Integrate all motions and write them, with every digit of a double."""
    motions = {name: integrated(name, len(times_of(rate))) for name, (_, rate) in BODIES.items()}
    document = {
        name: {"attitude": each.attitude.tolist(), "rate": each.rate.tolist()}
        for name, each in motions.items()
    }
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(motion)}" for name, motion in document.items())
    FILE.write_text(f"{{\n{lines}\n}}\n")


if __name__ == "__main__":
    main()
