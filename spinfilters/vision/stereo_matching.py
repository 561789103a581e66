"""Left-right matching on rows of rectified images, with sub-pixel refinement."""

from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from spinfilters.data.camera import StereoRig
from spinfilters.vision.features import Features
from spinfilters.vision.loss_count import LossCount

STAGE: Final = "stereo matches"


@dataclass(frozen=True)
class StereoMatching:
    """Options of left-right matching.

    Attributes
    ----------
    row_tolerance: rows by which the two places may differ before refinement, px, and a share of the feature's size.
    refined_row_tolerance: after it.   depths: nearest and farthest, m; beyond the farthest a point tells no depth.
    similarity: smallest product of descriptors.   ratio: of the distances to best and second best descriptor, at most (Lowe 2004).
    size_ratio: between the two, at most.   window: half width of the patch that is aligned, px.
    residual: mean grey difference of aligned patches over their contrast, at most.
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
    values: (n, 3) u_left, v_left, u_right, px.   features: of the left image.   residual: (n,) of the aligned patches, 0..1.
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
    """Matches of rectified images: points alike on one row.

    Rejected ones are counted by cause.
    """
    pairs = _best_on_row(left.features, right.features, rig, options, losses)
    chosen = left.features.part(pairs[:, 0])
    start = right.features.pixels[pairs[:, 1]]
    place, residual, found = _aligned(left.grey, right.grey, chosen.pixels, start, options)
    good = _counted(found, "not aligned", losses)
    rows = np.abs(place[:, 1] - chosen.pixels[:, 1]) <= options.refined_row_tolerance
    good &= _counted(rows | ~good, "off their row", losses)
    good &= _counted((residual <= options.residual) | ~good, "unlike after alignment", losses)
    values = np.column_stack([chosen.pixels, place[:, 0]])
    return StereoFeatures(values, chosen, residual).part(good)


def _counted(good: Bool[np.ndarray, " n"], cause: str, losses: LossCount) -> Bool[np.ndarray, " n"]:
    losses.lose(STAGE, cause, int(np.count_nonzero(~good)))
    return good


def _best_on_row(
    left: Features, right: Features, rig: StereoRig, options: StereoMatching, losses: LossCount
) -> Int[np.ndarray, "k 2"]:
    """Rows of left and right features that are each other's best, clearly."""
    if not len(left) or not len(right):
        return np.zeros((0, 2), dtype=int)
    gap = left.pixels[:, None] - right.pixels[None]
    nearest, farthest = options.depths
    scale = rig.left.fx * rig.baseline_m
    tolerance = options.row_tolerance + 0.1 * left.size[:, None]
    allowed = (
        (np.abs(gap[..., 1]) <= tolerance)
        & (gap[..., 0] <= scale / nearest)
        & (gap[..., 0] >= scale / farthest)
    )
    ratio = left.size[:, None] / right.size[None]
    allowed &= (ratio <= options.size_ratio) & (ratio >= 1 / options.size_ratio)
    similarity = np.where(allowed, left.descriptors @ right.descriptors.T, -1.0)
    return clear_pairs(similarity, options.similarity, options.ratio, losses, STAGE)


def clear_pairs(
    similarity: Float[np.ndarray, "n m"], smallest: float, ratio: float, losses: LossCount, stage: str
) -> Int[np.ndarray, "k 2"]:
    """Pairs (row, column) that are each other's best and clearly better than the row's second.

    Parameters
    ----------
    similarity: products of descriptors of unit length, -1 for pairs that are out of the question.
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


def _aligned(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    pixels: Float[np.ndarray, "k 2"],
    start: Float[np.ndarray, "k 2"],
    options: StereoMatching,
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """Aligned places of left patches in the right image (Lucas and Kanade 1981).

    The residuals come with them, and which were found.
    """
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
