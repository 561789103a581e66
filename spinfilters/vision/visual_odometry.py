"""Visual odometry from the starting epoch that finds most poses.

Epochs after a gap are not recognised by the few that went before. They are tried again with the map of all that was found, last
ones first; and where most are still lost, the sequence is begun anew at the first of them.
"""

from collections.abc import Callable, Sequence
from typing import Final

from spinfilters.data.camera import StereoRig
from spinfilters.vision.association import Tracker
from spinfilters.vision.epoch_observations import EpochObservations
from spinfilters.vision.front_end import FrontEndOptions
from spinfilters.vision.loss_count import LossCount
from spinfilters.vision.stereo_matching import StereoFeatures

ENOUGH: Final = 0.5
"""Share of the epochs to be found, else another beginning is tried."""
MOST_BEGINNINGS: Final = 3

TimedPoints = Sequence[tuple[float, StereoFeatures]]


def found_epochs(
    points: TimedPoints,
    rig: StereoRig,
    options: FrontEndOptions,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> list[EpochObservations]:
    """Epochs whose pose is found, in order of time.

    Parameters
    ----------
    points: times (s) and points of each pair.   progress: called with how many epochs are associated, and of how many.
    """
    best: dict[int, EpochObservations] = {}
    begin = 0
    for _ in range(MOST_BEGINNINGS):
        found = _from(points, begin, Tracker(rig, options.noise, LossCount(), options.association), progress)
        best = max(best, found, key=len)
        begin = next((number for number in range(begin, len(points)) if number not in found), len(points))
        if len(best) >= ENOUGH * len(points) or len(points) - begin <= len(best):
            break
    return [best[number] for number in sorted(best)]


def _from(
    points: TimedPoints, begin: int, tracker: Tracker, progress: Callable[[int, int], None]
) -> dict[int, EpochObservations]:
    """Epochs found from a beginning on, by number, then those that were lost, backwards."""
    found: dict[int, EpochObservations] = {}
    numbers = range(begin, len(points))
    for number in (*numbers, *reversed(range(len(points)))):
        epoch = None if number in found else tracker.add(number, *points[number])
        if epoch is not None:
            found[number] = epoch
        progress(len(found), len(points))
    return found
