"""Systems that several tests look at."""

from functools import cache

from observability import system as sensors
from observability.canonical_motions import CANONICAL_MOTIONS, CanonicalMotion, landmarks
from observability.coordinates import MOMENTS, RATIOS, Chart, FilterChart, PrincipalChart, TensorChart
from observability.system import System

CHARTS: tuple[Chart, ...] = (PrincipalChart(), TensorChart(), FilterChart())
MOTIONS: dict[str, CanonicalMotion] = {motion.name: motion for motion in CANONICAL_MOTIONS}
TUMBLE = MOTIONS["tumble"]
Z_SPIN = MOTIONS["spin about the minor axis"]
EULER = PrincipalChart(MOMENTS, with_attitude=False, with_place=False)
LOG_RATIOS = PrincipalChart(RATIOS, with_attitude=False, with_place=False)


@cache
def stereo_system(chart: Chart, count: int) -> System:
    """Unknown landmarks before a stereo pair."""
    return System(chart, [sensors.watching("stereo", landmarks(count))])
