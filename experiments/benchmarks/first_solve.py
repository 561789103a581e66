"""The first batch solution of a new process, from a file; prints its seconds as JSON: importing, frames, solving, and a few frames.

    python -m experiments.benchmarks.first_solve FILE

Everything is imported inside, for importing is part of what is timed.
"""

import json
import sys
from time import perf_counter
from typing import Any


def main(file: str) -> None:
    """Measure and print."""
    begin = perf_counter()
    import numpy as np

    from spinfilters.estimators.smoothing import problem, sightings, sliding, solver
    from spinfilters.estimators.smoothing.state_prior import FirstStatePrior
    from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
    from spinfilters.state.layout import FULL_BLOCKS, StateLayout

    imported = perf_counter() - begin
    with np.load(file) as arrays:
        data = dict(arrays)
    layout = StateLayout(FULL_BLOCKS)
    frames, prior = _frames(data, layout), FirstStatePrior(data["mean"], data["std"])
    process = TorqueFreeProcess(layout, ProcessNoise(*data["psd"].tolist()))
    built = perf_counter() - begin
    needed = sightings.SIGHTINGS_NEEDED
    made = problem.problem_of(process, frames, data["landmarks"], prior, needed)
    here = made.at(problem.with_common_constants(layout, data["trajectory"]), data["points"])
    found = solver.solve(made, here, solver.SolverOptions())
    solved = perf_counter() - begin
    smoother = sliding.SlidingSmoother(process, prior, sliding.SlidingOptions(), tied=True)
    for frame in frames[:3]:
        smoother.add(frame)
    slid = perf_counter() - begin
    print(json.dumps([imported, built, solved, slid, found.costs[-1]]))


def _frames(data: dict[str, Any], layout: Any) -> Any:
    from spinfilters.estimators.timeline import CameraView, SensorNoise, build_timeline
    from spinfilters.logs.measurement_log import MeasurementLog, MeasurementStream

    stream = MeasurementStream("stereo", data["time"], data["pixels"], data["ids"])
    noise, view = SensorNoise(pixel_std=1.0), CameraView(None, data["calibration"])
    return build_timeline(MeasurementLog((stream,)), layout, noise, view)


if __name__ == "__main__":
    main(sys.argv[1])
