"""Accuracy of the mean attitude of several scans, and scans that an accuracy takes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from spinfilters.lidar.scan_pose import ScanPose


def attitude_stds(poses: Sequence[ScanPose]) -> Float[np.ndarray, " n"]:
    """Standard deviations, rad, of the first 1, 2, ... n scans' mean attitude.

    They are of its least certain rotation. Scans that leave a rotation undetermined count for what they tell.
    """
    information = np.cumsum([np.linalg.inv(pose.covariance[3:, 3:]) for pose in poses], axis=0)
    return 1 / np.sqrt(np.linalg.eigvalsh(information)[:, 0])


def scans_needed(poses: Sequence[ScanPose], attitude_std: float) -> int:
    """Scans whose mean attitude is accurate to this, rad.

    The variance falls with their number.
    The closing question of Decoust (2008), for scans like these.
    """
    worst = float(attitude_stds(poses)[-1]) * np.sqrt(len(poses))
    return max(1, int(np.ceil((worst / attitude_std) ** 2)))
