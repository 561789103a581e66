"""Front end: rectified stereo pairs in, observations of landmarks out.

One pair at a time (online) or all of them (batch).
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import UInt8

from spinfilters.vision.association import Association, Tracker
from spinfilters.vision.epoch_observations import EpochObservations
from spinfilters.vision.features import Detector, Features, detector, exposure_gain, stretched
from spinfilters.vision.image_folder import ImagePair
from spinfilters.vision.loss_count import LossCount
from spinfilters.vision.outline import clear_of_outline
from spinfilters.vision.patch_alignment import aligned_patches
from spinfilters.vision.rectification import Rectification
from spinfilters.vision.stereo_matching import STAGE as STEREO
from spinfilters.vision.stereo_matching import SeenImage, StereoFeatures, StereoMatching, match_stereo
from spinfilters.vision.track_noise import TrackNoise

MARGIN_PX: Final = 32
"""Around the points of the last pair, where those of the next one are looked for."""
MARGIN_SHARE: Final = 0.2
"""Of their extent, that is added to the margin."""
FEWEST_SHARE: Final = 0.5
"""Of the last pair's points: fewer in that region, and the whole images are searched."""

Region = tuple[int, int, int, int]
"""First and last column, first and last row (the last ones excluded)."""


@dataclass(frozen=True)
class FrontEndOptions:
    """Options of the front end.

    Attributes
    ----------
    detector: "sift" or "orb".   stereo: left-right matching.   association: with landmarks.
    noise: of the observations, until it is identified.
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
        images = self._rectification.images(pair.left, pair.right)
        trial = LossCount()
        points = self._within(*images, self._region, trial)
        if self._region is not None and len(points) < FEWEST_SHARE * self._count:
            trial = LossCount()
            points = self._within(*images, None, trial)
        self._losses.add(trial)
        points = self._aligned(pair, points)
        self._count = len(points)
        self._region = _around(points, images[0].shape[::-1]) if len(points) else None
        return points

    def _aligned(self, pair: ImagePair, points: StereoFeatures) -> StereoFeatures:
        """Points with the disparity of the raw images."""
        if not len(points):
            return points
        found = aligned_patches(
            self._rectification, pair.left, pair.right, points.values[:, :2], points.disparity
        )
        self._losses.lose(STEREO, "not aligned", int(np.count_nonzero(~found.found)))
        self._losses.keep(STEREO, int(np.count_nonzero(found.found)))
        return points.aligned(found.disparity, found.residual).part(found.found)

    def _within(
        self,
        left: UInt8[np.ndarray, "h w"],
        right: UInt8[np.ndarray, "h w"],
        region: Region | None,
        losses: LossCount,
    ) -> StereoFeatures:
        first, last, top, bottom = region or (0, left.shape[1], 0, left.shape[0])
        cut = [np.ascontiguousarray(image[top:bottom, first:last]) for image in (left, right)]
        gain = exposure_gain(cut[0])
        left, right = (stretched(image, gain) for image in cut)
        of_left, of_right = self._threads.map(_detect, self._detectors, (left, right))
        seen = SeenImage(left, of_left), SeenImage(right, of_right)
        offset = np.array([first, top])
        rig = self._rectification.stereo
        points = match_stereo(seen[0], seen[1], rig, self._options.stereo, losses)
        clear = clear_of_outline((cut[0], cut[1]), points.values)
        losses.lose(STEREO, "at the outline of the body", int(np.count_nonzero(~clear)))
        return points.part(clear).moved(offset)


def _detect(finder: Detector, image: UInt8[np.ndarray, "h w"]) -> Features:
    return finder.detect(image)


def _around(points: StereoFeatures, size: tuple[int, ...]) -> Region:
    """A region that holds the points in both images, with a margin."""
    low = np.array([points.values[:, [0, 2]].min(), points.values[:, 1].min()])
    high = np.array([points.values[:, [0, 2]].max(), points.values[:, 1].max()])
    margin = MARGIN_PX + MARGIN_SHARE * (high - low)
    low = np.clip(np.floor(low - margin), 0, size).astype(int)
    high = np.clip(np.ceil(high + margin), 0, size).astype(int)
    return int(low[0]), int(high[0]), int(low[1]), int(high[1])


class OnlineFrontEnd:
    """Images as they come, observations out, without looking ahead.

    Attributes
    ----------
    losses: what was lost so far.
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
