"""Features of two rectified images and their matches along rows, refined below a pixel."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple, Protocol

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from spinfilters.core.errors import InputError
from spinfilters.io.camera import StereoRig
from spinfilters.io.input_file import value_text
from spinfilters.vision.image_folder import LossCount

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
    pixels : ndarray of shape (n, 2)
        Column and row.
    size : ndarray of shape (n,)
        Diameter, px.
    angle : ndarray of shape (n,)
        rad.
    descriptors : ndarray of shape (n, d)
        Of unit length: the product of two is 1 for the same look.
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
    """Finds feature points.

    Attributes
    ----------
    clearance : int
        px between places of interest and the border of an image, for nothing is found near that.
    """

    @property
    def clearance(self) -> int: ...

    def detect(self, image: UInt8[np.ndarray, "h w"]) -> Features:
        """Features of an image."""
        ...


class SiftDetector:
    """SIFT (Lowe 2004) with root descriptors (Arandjelovic and Zisserman 2012)."""

    clearance = 24
    """Five pixels of the third octave of the image's own size."""

    def __init__(self) -> None:
        self._sift = cv2.SIFT.create(
            nfeatures=MOST_FEATURES, contrastThreshold=SIFT_CONTRAST, enable_precise_upscale=True
        )

    def detect(self, image: UInt8[np.ndarray, "h w"]) -> Features:
        """SIFT points with root-normalised descriptors (k, 128)."""
        points, descriptors = self._sift.detectAndCompute(image, None)
        if descriptors is None:
            return _without_repeated((), np.zeros((0, 128)))
        return _without_repeated(
            points, np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1.0))
        )


class OrbDetector:
    """ORB features (Rublee et al. 2011), faster and less exact; descriptor bits are kept as +1 and -1."""

    clearance = 112
    """31 pixels of the last of eight levels, each 1.2 times as coarse as the one before."""

    def __init__(self) -> None:
        self._orb = cv2.ORB.create(nfeatures=MOST_FEATURES, fastThreshold=8)

    def detect(self, image: UInt8[np.ndarray, "h w"]) -> Features:
        """ORB points with descriptors (k, 256) of normalised signs."""
        points, descriptors = self._orb.detectAndCompute(image, None)
        if descriptors is None:
            return _without_repeated((), np.zeros((0, 256)))
        signs = np.unpackbits(np.asarray(descriptors, dtype=np.uint8), axis=1).astype(np.float32) * 2 - 1
        return _without_repeated(points, signs / np.sqrt(signs.shape[1]))


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


def _without_repeated(points: Sequence[cv2.KeyPoint], descriptors: np.ndarray) -> Features:
    """Features without those that a detector finds twice at one place with another angle."""
    pixels = np.array([point.pt for point in points], dtype=float).reshape(-1, 2)
    size = np.array([point.size for point in points], dtype=float)
    angle = np.deg2rad([point.angle for point in points])
    features = Features(pixels, size, angle, descriptors.astype(np.float32))
    if not len(features):
        return features
    first = np.unique(np.column_stack([pixels, size]), axis=0, return_index=True)[1]
    return features.part(np.sort(first))


STAGE: Final = "stereo matches"


@dataclass(frozen=True)
class StereoMatching:
    """Options of left-right matching.

    Attributes
    ----------
    row_tolerance : float
        Rows by which the two places may differ before refinement, px, and a share of the feature's size.
    refined_row_tolerance : float
        After it.
    depths : tuple[float, float]
        Nearest and farthest, m; beyond the farthest a point has no depth.
    similarity : float
        Smallest product of descriptors.
    ratio : float
        Of the distances to best and second best descriptor, at most (Lowe 2004).
    size_ratio : float
        Between the two, at most.
    window : int
        Half width of the patch that is aligned, px.
    residual : float
        Mean grey difference of aligned patches over their contrast, at most.
    """

    row_tolerance: float = 2.0
    refined_row_tolerance: float = 1.0
    depths: tuple[float, float] = (0.1, 10.0)
    similarity: float = 0.7
    ratio: float = 0.9
    size_ratio: float = 1.6
    window: int = 4
    residual: float = 0.6


@dataclass(frozen=True)
class StereoFeatures:
    """n points seen in both images.

    Attributes
    ----------
    values : ndarray of shape (n, 3)
        u_left, v_left, u_right, px.
    features : Features
        Of the left image.
    residual : ndarray of shape (n,)
        Of the aligned patches, 0..1.
    """

    values: Float[np.ndarray, "n 3"]
    features: Features
    residual: Float[np.ndarray, " n"] = field(repr=False)

    def __len__(self) -> int:
        return len(self.values)

    def part(self, chosen: Bool[np.ndarray, " n"]) -> "StereoFeatures":
        """Some of them."""
        return StereoFeatures(self.values[chosen], self.features.part(chosen), self.residual[chosen])

    @property
    def disparity(self) -> Float[np.ndarray, " n"]:
        """u_left - u_right, px."""
        return self.values[:, 0] - self.values[:, 2]

    def aligned(
        self, disparity: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]
    ) -> "StereoFeatures":
        """The points with other disparities and what their patches leave."""
        values = np.column_stack([self.values[:, :2], self.values[:, 0] - disparity])
        return StereoFeatures(values, self.features, residual)

    def moved(self, offset: Int[np.ndarray, " 2"]) -> "StereoFeatures":
        """Points of a part of the images in pixels of the whole ones."""
        features = replace(self.features, pixels=self.features.pixels + offset)
        return StereoFeatures(self.values + offset[[0, 1, 0]], features, self.residual)


class TimedFeatures(NamedTuple):
    """Points of a pair, and its time, s."""

    time: float
    points: "StereoFeatures"


class SeenImage(NamedTuple):
    """A rectified image and the features found in it."""

    grey: UInt8[np.ndarray, "h w"]
    features: Features


def match_stereo(
    left: SeenImage,
    right: SeenImage,
    rig: StereoRig,
    options: StereoMatching,
    losses: LossCount,
) -> StereoFeatures:
    """Matches of similar points on one row of rectified images; rejected ones are counted by cause."""
    pairs = _best_on_row(left.features, right.features, rig, options, losses)
    chosen = left.features.part(pairs[:, 0])
    start = right.features.pixels[pairs[:, 1]]
    place, residual, found = _align_patches(left.grey, right.grey, chosen.pixels, start, options)
    good = _count_losses(found, "not aligned", losses)
    rows = np.abs(place[:, 1] - chosen.pixels[:, 1]) <= options.refined_row_tolerance
    good &= _count_losses(rows | ~good, "off their row", losses)
    good &= _count_losses((residual <= options.residual) | ~good, "unlike after alignment", losses)
    values = np.column_stack([chosen.pixels, place[:, 0]])
    return StereoFeatures(values, chosen, residual).part(good)


def _count_losses(good: Bool[np.ndarray, " n"], cause: str, losses: LossCount) -> Bool[np.ndarray, " n"]:
    losses.lose(STAGE, cause, int(np.count_nonzero(~good)))
    return good


def _best_on_row(
    left: Features, right: Features, rig: StereoRig, options: StereoMatching, losses: LossCount
) -> Int[np.ndarray, "k 2"]:
    """Rows of left and right features that are each other's best, clearly."""
    if not len(left) or not len(right):
        return np.zeros((0, 2), dtype=int)
    # of all pairs, few are on one row: the other limits are looked at for these alone
    tolerance = options.row_tolerance + 0.1 * left.size[:, None]
    one, other = np.nonzero(np.abs(left.pixels[:, 1, None] - right.pixels[:, 1]) <= tolerance)
    disparity = left.pixels[one, 0] - right.pixels[other, 0]
    nearest, farthest = options.depths
    scale = rig.left.fx * rig.baseline_m
    allowed = (disparity <= scale / nearest) & (disparity >= scale / farthest)
    ratio = left.size[one] / right.size[other]
    allowed &= (ratio <= options.size_ratio) & (ratio >= 1 / options.size_ratio)
    one, other = one[allowed], other[allowed]
    products = left.descriptors @ right.descriptors.T
    similarity = np.full_like(products, -1.0)
    similarity[one, other] = products[one, other]
    return clear_pairs(similarity, options.similarity, options.ratio, losses, STAGE)


def clear_pairs(
    similarity: Float[np.ndarray, "n m"], smallest: float, ratio: float, losses: LossCount, stage: str
) -> Int[np.ndarray, "k 2"]:
    """Pairs (row, column) that are each other's best and clearly better than the row's second.

    Parameters
    ----------
    similarity : ndarray of shape (n, m)
        Products of descriptors of unit length, -1 for pairs that are out of the question.
    """
    if not similarity.size:
        return np.zeros((0, 2), dtype=int)
    rows = np.arange(len(similarity))
    best = similarity.argmax(axis=1)
    value = similarity[rows, best]
    mutual = similarity.argmax(axis=0)[best] == rows
    without = similarity.copy()
    without[rows, best] = -1.0
    second = without.max(axis=1)
    distance, other = (np.sqrt(np.maximum(2 - 2 * each, 0)) for each in (value, second))
    known, clear = value >= smallest, distance <= ratio * other
    losses.lose(stage, "without a counterpart", int(np.count_nonzero(~known)))
    losses.lose(stage, "ambiguous", int(np.count_nonzero(known & ~clear)))
    losses.lose(stage, "not mutual", int(np.count_nonzero(known & clear & ~mutual)))
    chosen = known & clear & mutual
    return np.column_stack([rows[chosen], best[chosen]])


def _align_patches(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    pixels: Float[np.ndarray, "k 2"],
    start: Float[np.ndarray, "k 2"],
    options: StereoMatching,
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """Left patches aligned in the right image (Lucas and Kanade 1981): places, residuals and which converged."""
    if not len(pixels):
        return np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=bool)
    side = 2 * options.window + 1
    place, status, error = cv2.calcOpticalFlowPyrLK(
        left,
        right,
        pixels.astype(np.float32)[:, None],
        start.astype(np.float32)[:, None].copy(),
        winSize=(side, side),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.003),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=1e-4,
    )
    found = status[:, 0] == 1  # elsewhere the other arrays hold whatever memory held
    place = np.where(found[:, None], place[:, 0], start.astype(np.float32)).astype(float)
    error = np.where(found, error[:, 0], np.float32(0)).astype(float)
    moved = np.linalg.norm(place - start, axis=1) <= options.window / 2
    contrast = _contrast(left, pixels, options.window)
    return place, error / np.maximum(contrast, 1.0), found & moved


def _contrast(
    image: UInt8[np.ndarray, "h w"], pixels: Float[np.ndarray, "k 2"], window: int
) -> Float[np.ndarray, " k"]:
    """Standard deviation of the grey values around each place."""
    grey, side = image.astype(np.float32), (2 * window + 1,) * 2
    mean, square = cv2.boxFilter(grey, -1, side), cv2.boxFilter(grey * grey, -1, side)
    column, row = np.clip(np.round(pixels).astype(int), 0, np.array(image.shape[::-1]) - 1).T
    return np.sqrt(np.maximum(square - mean * mean, 0.0))[row, column].astype(float)


@dataclass(frozen=True)
class EpochObservations:
    """Landmark observations of one epoch.

    Attributes
    ----------
    epoch : int
        Number.
    time : float
        s.
    pose : ndarray of shape (7,)
        (t, q_ig) of g.
    ids : ndarray of shape (n,)
        Landmarks.
    points : StereoFeatures
        The features that they are.
    covariance : ndarray of shape (n, 3, 3)
        px^2.
    """

    epoch: int
    time: float
    pose: Float[np.ndarray, " 7"]
    ids: Int[np.ndarray, " n"]
    points: StereoFeatures
    covariance: Float[np.ndarray, "n 3 3"]
