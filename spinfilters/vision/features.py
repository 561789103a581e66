"""Feature points of one image: places, sizes and descriptors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from spinfilters.data.input_file import value_text
from spinfilters.errors import InputError

SIFT_CONTRAST: Final = 0.02
"""Of the difference of Gaussians, grey values over 255; lower than OpenCV's 0.04, for blurred and dark images."""
MOST_FEATURES: Final = 1200
"""Of an image: the strongest, so that the cost of matching is bounded."""
BRIGHT: Final = 220.0
"""Grey value to which the brightest part of what is looked at is stretched, so that exposure does not change what is found."""
LARGEST_GAIN: Final = 8.0
BRIGHTEST_SHARE: Final = 99.5


@dataclass(frozen=True)
class Features:
    """n feature points.

    Attributes
    ----------
    pixels: (n, 2) column and row.   size: (n,) diameter, px.   angle: (n,) rad.
    descriptors: (n, d) of unit length: the product of two is 1 for the same look.
    """

    pixels: Float[np.ndarray, "n 2"]
    size: Float[np.ndarray, " n"]
    angle: Float[np.ndarray, " n"]
    descriptors: Float[np.ndarray, "n d"]

    def __len__(self) -> int:
        return len(self.pixels)

    def part(self, chosen: Bool[np.ndarray, " n"] | Int[np.ndarray, " k"]) -> "Features":
        """Some of them."""
        return Features(self.pixels[chosen], self.size[chosen], self.angle[chosen], self.descriptors[chosen])


class Detector(Protocol):
    """Finds feature points."""

    def detect(self, image: UInt8[np.ndarray, "h w"]) -> Features:
        """Features of an image."""
        ...


class SiftDetector:
    """SIFT (Lowe 2004) with root descriptors (Arandjelovic and Zisserman 2012)."""

    def __init__(self) -> None:
        self._sift = cv2.SIFT.create(
            nfeatures=MOST_FEATURES, contrastThreshold=SIFT_CONTRAST, enable_precise_upscale=True
        )

    def detect(self, image: UInt8[np.ndarray, "h w"]) -> Features:
        """SIFT points with root-normalised descriptors (k, 128)."""
        points, descriptors = self._sift.detectAndCompute(image, None)
        if descriptors is None:
            return _features((), np.zeros((0, 128)))
        return _features(
            points, np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1.0))
        )


class OrbDetector:
    """ORB features (Rublee et al. 2011): faster and less exact.

    Bits are kept as +1 and -1.
    """

    def __init__(self) -> None:
        self._orb = cv2.ORB.create(nfeatures=MOST_FEATURES, fastThreshold=8)

    def detect(self, image: UInt8[np.ndarray, "h w"]) -> Features:
        """ORB points with descriptors (k, 256) of normalised signs."""
        points, descriptors = self._orb.detectAndCompute(image, None)
        if descriptors is None:
            return _features((), np.zeros((0, 256)))
        signs = np.unpackbits(np.asarray(descriptors, dtype=np.uint8), axis=1).astype(np.float32) * 2 - 1
        return _features(points, signs / np.sqrt(signs.shape[1]))


DETECTORS: Final = {"sift": SiftDetector, "orb": OrbDetector}


def detector(name: str) -> Detector:
    """A detector by name. InputError: an unknown one."""
    if name not in DETECTORS:
        raise InputError(f"detector {value_text(name)} is unknown; use {' or '.join(DETECTORS)}")
    return DETECTORS[name]()


def stretched(image: UInt8[np.ndarray, "h w"], gain: float) -> UInt8[np.ndarray, "h w"]:
    """The image with its grey values multiplied."""
    return image if gain == 1.0 else cv2.convertScaleAbs(image, alpha=gain)


def exposure_gain(image: UInt8[np.ndarray, "h w"]) -> float:
    """Factor that brings the brightest part of an image to `BRIGHT`."""
    brightest = float(np.percentile(image, BRIGHTEST_SHARE))
    return float(np.clip(BRIGHT / max(brightest, 1.0), 1.0, LARGEST_GAIN))


def _features(points: Sequence[cv2.KeyPoint], descriptors: np.ndarray) -> Features:
    """Features without those that a detector finds twice at one place with another angle."""
    pixels = np.array([point.pt for point in points], dtype=float).reshape(-1, 2)
    size = np.array([point.size for point in points], dtype=float)
    angle = np.deg2rad([point.angle for point in points])
    features = Features(pixels, size, angle, descriptors.astype(np.float32))
    if not len(features):
        return features
    first = np.unique(np.column_stack([pixels, size]), axis=0, return_index=True)[1]
    return features.part(np.sort(first))
