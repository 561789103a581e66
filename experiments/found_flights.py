"""Found free flights beside those that people marked.

And beside the contact that geometry tells.
    python -m experiments.found_flights DATA

Of the thrown phone and racquet: flights found and marked, and how far their ends lie apart. Of the thrown cubes: end of the first
flight against the first contact of a corner, and the acceleration. Of a gyro and poses in a hand: flights found, which is none.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from experiments.command_line import run_study
from spinfilters.run.free_flight import find_flights
from spinfilters.run.gyro_flights import gyro_flights
from spinfilters.run.pose_flights import PoseLog, acceleration_of, pose_flights
from spinfilters.run.readers import read_dataset, read_segments, read_whole

HALF_EDGE = 0.0524
"""Of the cube, m."""
HELD_RATE = 285.714
"""Hz, of the recording in a hand."""
NEAR_GROUND = 0.0015
"""m above the height of rest at which a corner counts as touching."""


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    data = parser.parse_args().data
    throws(data / "racquet_phyphox" / "data")
    cubes(data / "contactnets_cube_tosses")
    others(data)
    held(data / "broad_imu_optical" / "07_undisturbed_fast_rotation_B.hdf5")


def throws(data: Path) -> None:
    """Found beside marked segments of the phyphox recordings."""
    late: list[tuple[float, float]] = []
    found, marked, extra = 0, 0, 0
    for folder in sorted(data.glob("*/*")):
        spans = [(flight.start, flight.end) for flight in find_flights(read_whole(folder))]
        logs = [dataset.log for dataset in read_segments(folder)]
        pairs = [[log for log in logs if log.start < end and log.end > start] for start, end in spans]
        late += [
            (s - log.start, e - log.end) for (s, e), pair in zip(spans, pairs, strict=True) for log in pair
        ]
        found, marked = found + sum(map(bool, pairs)), marked + len(logs)
        extra += sum(not pair for pair in pairs)
    start, end = np.median(late, axis=0)
    print(
        f"throws: {found} of {marked} marked segments found and {extra} more; start {start:+.3f} s, end {end:+.3f} s from the mark "
        "in the median"
    )


def cubes(data: Path) -> None:
    """Ends of the first flights beside the first contact, and the acceleration."""
    corners = HALF_EDGE * np.array(json.loads((data / "experiment.json").read_text())["vertices"])
    late, strength = [], []
    for path in sorted(data.glob("*.csv")):
        stream = read_dataset(path).log.stream("pose")
        log = PoseLog.of(stream.time, stream.values, None)
        flights = pose_flights(log)
        lowest = np.min([(log.attitude @ corner + log.position)[:, 2] for corner in corners], axis=0)
        contact = int(np.flatnonzero(lowest < np.median(lowest[-15:]) + NEAR_GROUND)[0])
        if flights:
            late.append(flights[0].end - contact)
            strength.append(float(np.linalg.norm(acceleration_of(log, flights[0])[0])))
    counts = {int(each): late.count(each) for each in sorted(set(late))}
    print(
        f"cubes: {len(late)} first flights, samples after contact: {counts}, acceleration {np.mean(strength):.2f} m/s^2"
    )


def others(data: Path) -> None:
    """Recordings with at least one flight."""
    for name in ("hinged_elbow_tosses", "suchai3_gyro", "flatball_discs"):
        paths = sorted(path.parent for path in (data / name).glob("*/dataset.toml"))
        flying = [path for path in paths if find_flights(read_dataset(path))]
        print(f"{name}: flights in {len(flying)} of {len(paths)}")


def held(path: Path) -> None:
    """Flights in a recording that never leaves the hand."""
    import h5py

    with h5py.File(path) as file:
        rates, position, attitude = (np.array(file[name]) for name in ("imu_gyr", "opt_pos", "opt_quat"))
    time = np.arange(len(rates)) / HELD_RATE
    seen = np.isfinite(position).all(axis=1) & np.isfinite(attitude).all(axis=1)
    poses = np.hstack([position, attitude[:, [1, 2, 3, 0]]])[seen]
    in_poses = pose_flights(PoseLog.of(time[seen], poses, None))
    print(
        f"in a hand, {time[-1]:.0f} s: {len(gyro_flights(time, rates))} flights in rates, {len(in_poses)} in poses"
    )


if __name__ == "__main__":
    run_study(main)
