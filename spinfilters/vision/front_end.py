"""Front end: rectified stereo pairs in, observations of landmarks out.

One pair at a time (online) or all of them (batch). Points at the outline of the body are left out; disparities are those of
patches of the raw images.

What an outline hides from one camera the other sees: 9 cm beside it at 0.6 m, both see another edge of a round body. A patch
that holds the outline is aligned with neither surface, and its disparity is too small: by 0.06 px within 3 px of it, by 0.3 px
in images with a blur 5 px wide (rendered spheres). Errors of that sign at all outlines are those of another focal length.

Disparities are refined on the grey values of small patches. A plane's disparity is linear over the image, so a patch of the
right image is that of the left one under

    u_right = u_left - d + a (u - u_left) + b (v - v_left),

with d, a and b such that the weighted squares of T - g I - o are least: T and I grey values of left and right, g and o gain and
offset. A shift alone has an error of a tenth of a pixel where the surface is steep: which part of the patch has most texture
decides. Grey values come from the raw images, at the places that rectification gives: interpolating twice, first onto the grid
of rectified pixels, moves texture by a hundredth of a pixel, by the same one wherever the map has the same fraction.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from spinfilters.core.robust_losses import median_deviation
from spinfilters.vision.association import Association, Tracker
from spinfilters.vision.image_folder import ImagePair, LossCount
from spinfilters.vision.rectification import Rectification
from spinfilters.vision.stereo_matching import STAGE as STEREO
from spinfilters.vision.stereo_matching import (
    Detector,
    EpochObservations,
    Features,
    SeenImage,
    StereoFeatures,
    StereoMatching,
    detector,
    exposure_gain,
    match_stereo,
    stretched,
)
from spinfilters.vision.track_noise import TrackNoise

MARGIN_PX: Final = 7.0
"""From the background: a patch's half width, and what a moderate blur spreads over."""
SPREADS: Final = 4.0
LEAST_DIFFERENCE, LARGEST_SPREAD = 3.0, 6.0
"""Grey values: by which the body differs from the background at least, and what an even background spreads at most."""
LARGEST_SHARE: Final = 0.5
"""Of the points: more near what is even, and that is the body itself, or it is too small for a margin."""

Image = UInt8[np.ndarray, "h w"]


def clear_of_outline(
    images: Sequence[Image], values: Float[np.ndarray, "n 3"], margin: float = MARGIN_PX
) -> Bool[np.ndarray, " n"]:
    """Whether points (u_left, v_left, u_right) keep a margin, px, from the background in both images."""
    return _clear_of_background([background_distance(image) for image in images], values, margin)


def _clear_of_background(
    distances: Sequence[Float[np.ndarray, "h w"]], values: Float[np.ndarray, "n 3"], margin: float = MARGIN_PX
) -> Bool[np.ndarray, " n"]:
    """The same with the distances of both images' pixels to the background."""
    clear = np.ones(len(values), dtype=bool)
    for distance, columns in zip(distances, ([0, 1], [2, 1]), strict=True):
        column, row = np.clip(
            np.rint(values[:, columns]).astype(int), 0, np.array(distance.shape[::-1]) - 1
        ).T
        clear &= distance[row, column] >= margin
    return clear if np.count_nonzero(~clear) <= LARGEST_SHARE * len(clear) else np.ones_like(clear)


def background_distance(image: Image) -> Float[np.ndarray, "h w"]:
    """Distance of each pixel to the even background that reaches the border, px; infinite without one."""
    border = _border(image)
    level = float(np.median(border))
    spread = median_deviation(border - level)
    if spread > LARGEST_SPREAD:
        return np.full(image.shape, np.inf)
    allowed = max(LEAST_DIFFERENCE, SPREADS * spread)
    even = cv2.inRange(cv2.medianBlur(image, 3), np.ceil(level - allowed), np.floor(level + allowed))
    count, labelled = cv2.connectedComponents(even)
    labels, body = np.asarray(labelled, dtype=np.int32), np.ones(count, dtype=np.uint8)
    body[_border(labels)] = 0
    body[0] = 1  # what is not even
    if body.all():
        return np.full(image.shape, np.inf)
    return cv2.distanceTransform(body[labels], cv2.DIST_L2, cv2.DIST_MASK_5)


def _border(image: np.ndarray) -> np.ndarray:
    """First and last row, then first and last column between them."""
    return np.concatenate([image[0], image[-1], image[1:-1, 0], image[1:-1, -1]])


HALF: Final = 5
"""Half width of a patch, px."""
SPREAD_PX: Final = 2.5
"""Standard deviation of the weights over the patch: what lies beyond an edge of the body is at another depth."""
ITERATIONS: Final = 8
SETTLED_PX: Final = 2e-3
LARGEST_STEP_PX: Final = 1.0
LARGEST_CHANGE_PX: Final = 2.0
"""Of the disparity, beyond which the patch has left its counterpart."""
LARGEST_SLOPE: Final = 0.6
"""Of the disparity by the place; more is foreshortened beyond recognition."""
DAMPING: Final = (1e-3, 2.0, 2.0)
"""Squared grey values per px that are added to the information, so that a patch without texture has a solution."""

Patches = Float[np.ndarray, "n m"]


@dataclass(frozen=True)
class PatchAlignment:
    """Disparities of n points.

    Attributes
    ----------
    disparity : ndarray of shape (n,)
        px.
    residual : ndarray of shape (n,)
        Of the grey values after alignment over their contrast, 0..1.
    found : ndarray of shape (n,)
    """

    disparity: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]
    found: Bool[np.ndarray, " n"]


def aligned_patches(
    rectification: Rectification,
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    pixels: Float[np.ndarray, "n 2"],
    start: Float[np.ndarray, " n"],
) -> PatchAlignment:
    """Disparities of rectified pixels of the left raw image, from a start, px."""
    if not len(pixels):
        return PatchAlignment(start, np.zeros(0), np.zeros(0, dtype=bool))
    views = [
        _View(rectification, camera, image.astype(np.float32)) for camera, image in enumerate((left, right))
    ]
    template, slope = views[0].patches(pixels, np.zeros((len(pixels), 3)))
    shape = np.stack([-start, np.zeros(len(pixels)), np.zeros(len(pixels))], axis=1)
    moving = np.arange(len(pixels))
    for _ in range(ITERATIONS):
        fit = _Fit.of(template[moving], slope[moving], *views[1].patches(pixels[moving], shape[moving]))
        step = fit.step
        shape[moving] += step
        moving = moving[np.abs(step[:, 0]) > SETTLED_PX]
        if not len(moving):
            break
    residual = _Fit.of(template, slope, *views[1].patches(pixels, shape)).residual
    change = np.abs(-shape[:, 0] - start)
    found = (change <= LARGEST_CHANGE_PX) & (np.abs(shape[:, 1:]) <= LARGEST_SLOPE).all(axis=1)
    return PatchAlignment(-shape[:, 0], residual, found & np.isfinite(residual))


_ALONG = np.arange(-HALF - 1, HALF + 2, dtype=float)
_X, _Y = (grid[None].astype(np.float32) for grid in np.meshgrid(_ALONG, _ALONG[1:-1]))
"""Places of a patch about its middle, a column wider on both sides than what is compared, for the derivative."""
_BASIS = np.stack([np.ones_like(_X), _X, _Y], axis=3)[0, :, 1:-1].reshape(-1, 3).astype(np.float32)
_PRODUCTS = (_BASIS[:, :, None] * _BASIS[:, None]).reshape(-1, 9)
_WEIGHT = np.exp(-(_BASIS[:, 1] ** 2 + _BASIS[:, 2] ** 2) / (2 * SPREAD_PX**2))
_WEIGHT = (_WEIGHT / _WEIGHT.sum()).astype(np.float32)


@dataclass(frozen=True)
class _View:
    """Grey values of one raw image at rectified places."""

    rectification: Rectification
    camera: int
    image: Float[np.ndarray, "h w"]

    def patches(
        self, pixels: Float[np.ndarray, "n 2"], shape: Float[np.ndarray, "n 3"]
    ) -> tuple[Patches, Patches]:
        """Grey values of shifted, sheared patches and derivatives along the row."""
        middle, row = (pixels + shape[:, :1] * [1, 0]).astype(np.float32).T[..., None, None]
        along, across = shape[:, 1:].astype(np.float32).T[..., None, None]
        x = middle + (1 + along) * _X + across * _Y
        y = np.broadcast_to(row + _Y, x.shape)
        grey = self.rectification.grey_at(self.camera, self.image, x, y)
        slope = (grey[:, :, 2:] - grey[:, :, :-2]) / (2 * (1 + along))
        return grey[:, :, 1:-1].reshape(len(pixels), -1), slope.reshape(len(pixels), -1)


@dataclass(frozen=True)
class _Fit:
    """Least squares of a step, gain and offset eliminated.

    Attributes
    ----------
    template, error : ndarray of shape (n, m)
        Grey values of the left patch, and what they differ by from the right one, both without their means.
    slope : ndarray of shape (n, m)
        Mean of both patches' derivatives along the row.
    """

    template: Patches
    error: Patches
    slope: Patches

    @classmethod
    def of(cls, template: Patches, slope: Patches, grey: Patches, own_slope: Patches) -> "_Fit":
        """Each template with its right patch."""
        T, own = _remove_mean(template), _remove_mean(grey)
        power = np.maximum((own * own) @ _WEIGHT, 1e-6)
        gain = np.clip((T * own) @ _WEIGHT / power, 0.5, 2.0)[:, None]
        return cls(T, T - gain * own, (gain * own_slope + slope) / 2)

    @property
    def step(self) -> Float[np.ndarray, "n 3"]:
        """Damped Gauss-Newton step of shift and slopes."""
        # J = s B without its weighted mean m, B the basis: J'wJ = B'(w s^2)B - m m', and J'w e = B'(w s e) as e has no mean
        weighted = self.slope * _WEIGHT
        mean = weighted @ _BASIS
        information = ((weighted * self.slope) @ _PRODUCTS).reshape(-1, 3, 3).astype(float)
        information += np.diag(DAMPING) - mean[:, :, None] * mean[:, None]
        right = ((weighted * self.error) @ _BASIS).astype(float)
        step = np.linalg.solve(information, right[..., None])[..., 0]
        step[:, 0] = np.clip(step[:, 0], -LARGEST_STEP_PX, LARGEST_STEP_PX)
        return step

    @property
    def residual(self) -> Float[np.ndarray, " n"]:
        """Root mean square of the errors over the contrast of the left patch."""
        contrast = np.sqrt((self.template * self.template) @ _WEIGHT)
        return np.sqrt((self.error * self.error) @ _WEIGHT) / np.maximum(contrast, 1.0)


def _remove_mean(values: np.ndarray) -> np.ndarray:
    """Without the weighted mean of each patch."""
    return values - (values @ _WEIGHT)[:, None]


FRONT_END_MARGIN_PX: Final = 32
"""Around the points of the last pair, where those of the next one are looked for."""
MARGIN_SHARE: Final = 0.2
"""Of their extent, that is added to the margin."""
FEWEST_SHARE: Final = 0.5
"""Of the last pair's points: fewer in that region, and the whole images are searched."""
STAR_PX: Final = 2.0
"""Half the width of a spot that is no part of a body."""
GRID_PX: Final = 8
"""Between pixels of the fourth octave."""

Region = tuple[int, int, int, int]
"""First and last column, first and last row (the last ones excluded)."""


@dataclass(frozen=True)
class FrontEndOptions:
    """Options of the front end.

    Attributes
    ----------
    detector : str
        "sift" or "orb".
    stereo : StereoMatching
        Left-right matching.
    association : Association
        With landmarks.
    noise : TrackNoise
        Of the observations, until it is identified.
    """

    detector: str = "sift"
    stereo: StereoMatching = field(default_factory=StereoMatching)
    association: Association = field(default_factory=Association)
    noise: TrackNoise = field(default_factory=TrackNoise)


class StereoPoints:
    """Points of one stereo pair after the other.

    Features are looked for around those of the pair before.
    """

    def __init__(self, rectification: Rectification, options: FrontEndOptions, losses: LossCount) -> None:
        self._rectification, self._options, self._losses = rectification, options, losses
        self._detectors: tuple[Detector, Detector] = (detector(options.detector), detector(options.detector))
        self._threads = ThreadPoolExecutor(2)
        self._region: Region | None = None
        self._count = 0

    def of(self, pair: ImagePair) -> StereoFeatures:
        """Points of a raw pair."""
        trial = LossCount()
        points = self._detect_within(pair, self._region, trial)
        if self._region is not None and len(points) < FEWEST_SHARE * self._count:
            trial = LossCount()
            points = self._detect_within(pair, None, trial)
        self._losses.add(trial)
        points = self._align_to_raw(pair, points)
        self._count = len(points)
        self._region = _region_around(points, pair.left.shape[::-1]) if len(points) else None
        return points

    def _align_to_raw(self, pair: ImagePair, points: StereoFeatures) -> StereoFeatures:
        """Points with the disparity of the raw images."""
        if not len(points):
            return points
        found = aligned_patches(
            self._rectification, pair.left, pair.right, points.values[:, :2], points.disparity
        )
        self._losses.lose(STEREO, "not aligned", int(np.count_nonzero(~found.found)))
        self._losses.keep(STEREO, int(np.count_nonzero(found.found)))
        return points.aligned(found.disparity, found.residual).part(found.found)

    def _detect_within(self, pair: ImagePair, region: Region | None, losses: LossCount) -> StereoFeatures:
        first, last, top, bottom = region or _whole(pair.left)
        within = slice(first, last), slice(top, bottom)
        cut = self._rectification.images(pair.left, pair.right, *within)
        gain, distances = exposure_gain(cut[0]), [background_distance(image) for image in cut]
        left, right = (stretched(image, gain) for image in cut)
        # without a region of the last pair all is searched, also what is as dark as the background
        boxes = [_whole(image) if region is None else self._body_box(image) for image in distances]
        of_left, of_right = self._threads.map(_detect, self._detectors, (left, right), boxes)
        seen = SeenImage(left, of_left), SeenImage(right, of_right)
        offset = np.array([first, top])
        rig = self._rectification.stereo
        points = match_stereo(seen[0], seen[1], rig, self._options.stereo, losses)
        clear = _clear_of_background(distances, points.values)
        losses.lose(STEREO, "at the outline of the body", int(np.count_nonzero(~clear)))
        return points.part(clear).moved(offset)

    def _body_box(self, distance: Float[np.ndarray, "h w"]) -> Region:
        """The body, also where parts of it are as dark as the background, but no star; with the detector's clearance."""
        column, row, width, height = cv2.boundingRect((distance > STAR_PX).astype(np.uint8))
        if not width:
            return _whole(distance)
        clearance = self._detectors[0].clearance
        # from a pixel of every octave on, so that the part has the scale space of the whole
        first, top = (max(each - clearance, 0) // GRID_PX * GRID_PX for each in (column, row))
        return first, column + width + clearance, top, row + height + clearance


def _detect(finder: Detector, image: UInt8[np.ndarray, "h w"], box: Region) -> Features:
    """Features within a box, in pixels of the image."""
    first, last, top, bottom = box
    found = finder.detect(np.ascontiguousarray(image[top:bottom, first:last]))
    return replace(found, pixels=found.pixels + np.array([first, top]))


def _whole(image: np.ndarray) -> Region:
    return 0, image.shape[1], 0, image.shape[0]


def _region_around(points: StereoFeatures, size: tuple[int, ...]) -> Region:
    """A region that holds the points in both images, with a margin."""
    low = np.array([points.values[:, [0, 2]].min(), points.values[:, 1].min()])
    high = np.array([points.values[:, [0, 2]].max(), points.values[:, 1].max()])
    margin = FRONT_END_MARGIN_PX + MARGIN_SHARE * (high - low)
    low = np.clip(np.floor(low - margin), 0, size).astype(int)
    high = np.clip(np.ceil(high + margin), 0, size).astype(int)
    return int(low[0]), int(high[0]), int(low[1]), int(high[1])


class OnlineFrontEnd:
    """Images as they come, observations out, without looking ahead.

    Attributes
    ----------
    losses : LossCount or None
        What was lost so far.
    """

    def __init__(
        self,
        rectification: Rectification,
        options: FrontEndOptions | None = None,
        losses: LossCount | None = None,
    ) -> None:
        options = options or FrontEndOptions()
        self.losses = LossCount() if losses is None else losses
        self._points = StereoPoints(rectification, options, self.losses)
        self._tracker = Tracker(rectification.stereo, options.noise, self.losses, options.association)
        self._epoch = 0

    def add(self, pair: ImagePair) -> EpochObservations | None:
        """Observations of the next pair, or None where no pose is found."""
        self._epoch += 1
        return self._tracker.add(self._epoch - 1, pair.time, self._points.of(pair))
