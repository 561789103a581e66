"""The first batch solution of a new process, from a file.

Prints its seconds as JSON: importing, frames, solving, and a few frames.
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

    from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
    from spinfilters.models.state_layout import FULL_BLOCKS, StateLayout
    from spinfilters.smoother import landmark_factors as landmark_observations
    from spinfilters.smoother import problem as least_squares
    from spinfilters.smoother import sliding_smoother
    from spinfilters.smoother import solver as iterations
    from spinfilters.smoother.priors import FirstStatePrior

    imported = perf_counter() - begin
    with np.load(file) as arrays:
        data = dict(arrays)
    layout = StateLayout(FULL_BLOCKS)
    epochs, prior = _frames(data, layout), FirstStatePrior(data["mean"], data["std"])
    process = TorqueFreeProcess(layout, ProcessNoise(*data["psd"].tolist()))
    built = perf_counter() - begin
    needed = landmark_observations.OBSERVATIONS_NEEDED
    made = least_squares.problem_of(process, epochs, data["landmarks"], prior, needed)
    here = made.at(least_squares.with_common_constants(layout, data["trajectory"]), data["points"])
    found = iterations.solve(made, here, iterations.SolverOptions())
    solved = perf_counter() - begin
    options = sliding_smoother.SmootherOptions()
    smoother = sliding_smoother.SlidingSmoother(process, prior, options, has_landmarks=True)
    for frame in epochs[:3]:
        smoother.add(frame)
    slid = perf_counter() - begin
    print(json.dumps([imported, built, solved, slid, found.costs[-1]]))


def _frames(data: dict[str, Any], layout: Any) -> Any:
    from spinfilters.filters.timeline import CameraView, SensorNoise, build_timeline
    from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream

    stream = MeasurementStream("stereo", data["time"], data["pixels"], data["ids"])
    noise, view = SensorNoise(pixel_std=1.0), CameraView(None, data["calibration"])
    return build_timeline(MeasurementLog((stream,)), layout, noise, view)


if __name__ == "__main__":
    main(sys.argv[1])
