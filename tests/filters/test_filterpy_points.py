"""filterpy's sigma points alone are those of filterpy, which loads as ever afterwards."""

import subprocess
import sys

PROGRAM = """
import sys
import numpy as np
from spinfilters.filters.filterpy_points import merwe_points
alone = merwe_points(4, 0.6, 2.0, -1.0)
assert not [name for name in sys.modules if name.startswith("filterpy")]
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
whole = MerweScaledSigmaPoints(4, 0.6, 2.0, -1.0)
assert type(merwe_points(4, 0.6, 2.0, -1.0)) is type(whole)
covariance = np.diag([1.0, 2.0, 3.0, 4.0]) + 0.1
for one, other in (
    (alone.sigma_points(np.ones(4), covariance), whole.sigma_points(np.ones(4), covariance)),
    (alone.Wm, whole.Wm),
    (alone.Wc, whole.Wc),
):
    assert np.array_equal(one, other)
"""


def test_points_loaded_alone_are_those_of_the_whole_package() -> None:
    subprocess.run([sys.executable, "-c", PROGRAM], check=True)
