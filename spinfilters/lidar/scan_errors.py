"""Errors of a scanning lidar: noise and bias, lost returns."""

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from jaxtyping import Float, Int

AngleMode = Literal["jitter", "encoder", "thesis"]
ANGLE_MODES: Final = ("jitter", "encoder", "thesis")
"""jitter: the beam leaves its direction and nobody knows; encoder: the direction is read wrongly; thesis: the beam leaves its
direction and the encoder follows it, so that points stay on the surface (Decoust 2008, section 2.2.4)."""
MISS, RETURN, WEAK, SATURATED, DUST = 0, 1, 2, 3, 4
FLAG_WORDS: Final = {MISS: "miss", RETURN: "return", WEAK: "too weak", SATURATED: "saturated", DUST: "dust"}
"""Flags of a ray; 1 and 0 are the thesis'."""


@dataclass(frozen=True)
class LidarNoise:
    """Standard deviations and biases, m and rad.

    Attributes
    ----------
    range_std, azimuth_std, elevation_std: of white noise.   range_bias, azimuth_bias, elevation_bias: of what is reported.
    mode: of the angles' noise, see `ANGLE_MODES`.
    """

    range_std: float = 0.0
    azimuth_std: float = 0.0
    elevation_std: float = 0.0
    range_bias: float = 0.0
    azimuth_bias: float = 0.0
    elevation_bias: float = 0.0
    mode: AngleMode = "jitter"

    def drawn_angles(
        self, count: int, generator: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Deviations (azimuth, elevation) of the beams from their nominal directions, and of what is reported."""
        noise = generator.standard_normal((count, 2)) * [self.azimuth_std, self.elevation_std]
        fired = np.zeros_like(noise) if self.mode == "encoder" else noise
        read = np.zeros_like(noise) if self.mode == "jitter" else noise
        return fired, read + np.array([self.azimuth_bias, self.elevation_bias])


def rvs_noise(mode: AngleMode = "jitter", long_range: bool = False, biased: bool = False) -> LidarNoise:
    """Noise of Jena-Optronik's RVS: 3-sigma figures over three (Decoust 2008, Figure 2.11; Eq. 2.6 corrected).

    Parameters
    ----------
    long_range: 0.1 m (3 sigma) and a bias of 0.5 m instead of 0.01 m and 0.01 m.   biased: with the largest biases allowed.
    """
    range_bias, angle_bias = (0.5 if long_range else 0.01, np.deg2rad(0.1)) if biased else (0.0, 0.0)
    return LidarNoise(
        range_std=(0.1 if long_range else 0.01) / 3,
        azimuth_std=float(np.deg2rad(0.01)) / 3,
        elevation_std=float(np.deg2rad(0.02)) / 3,
        range_bias=range_bias,
        azimuth_bias=float(angle_bias),
        elevation_bias=float(angle_bias),
        mode=mode,
    )


@dataclass(frozen=True)
class Losses:
    """Causes of lost returns (Decoust 2008, section 2.1.2).

    Attributes
    ----------
    reflectivity: of a surface met head-on, 0 to 1; the intensity falls with the cosine of incidence.
    weakest, strongest: received power, intensity times (reference_range / range)^2, that the detector takes.
    reference_range: m.
    dust: probability that dust absorbs a beam.   clutter: probability that dust returns it from somewhere before the surface.
    sun: unit vector towards the sun, frame L, or None.   glint_deg: half angle within which the sun, or its mirror image in the
        surface, blinds the detector.
    """

    reflectivity: float = 1.0
    weakest: float = 0.0
    strongest: float = np.inf
    reference_range: float = 500.0
    dust: float = 0.0
    clutter: float = 0.0
    sun: tuple[float, float, float] | None = None
    glint_deg: float = field(default=2.0)

    def flags(
        self,
        directions: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        distance: Float[np.ndarray, " n"],
        generator: np.random.Generator,
    ) -> Int[np.ndarray, " n"]:
        """Flag of every ray, infinite distances being misses.

        Normals are those of the surfaces that were hit.
        """
        hit = np.isfinite(distance)
        power = (
            self.intensity(directions, normals)
            * (self.reference_range / np.where(hit, distance, np.inf)) ** 2
        )
        flags = np.where(hit, RETURN, MISS)
        flags[hit & (power < self.weakest)] = WEAK
        flags[hit & (power > self.strongest)] = SATURATED
        if self.sun is not None:
            flags[self._blinded(directions, normals, hit)] = SATURATED
        flags[generator.random(len(flags)) < self.dust] = DUST
        return flags

    def intensity(
        self, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        """Lambert's law: reflectivity times the cosine of incidence."""
        return self.reflectivity * np.abs(np.einsum("ni,ni->n", directions, normals))

    def _blinded(
        self, directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], hit: np.ndarray
    ) -> np.ndarray:
        sun = np.asarray(self.sun) / np.linalg.norm(np.asarray(self.sun))
        least = np.cos(np.deg2rad(self.glint_deg))
        mirrored = 2 * (normals @ sun)[:, None] * normals - sun
        lit = normals @ sun > 0
        glint = hit & lit & (-np.einsum("ni,ni->n", mirrored, directions) > least)
        return glint | (~hit & (directions @ sun > least))
