"""Valid inputs of every kind, small, from which hostile ones are made."""

import shutil
from pathlib import Path

import numpy as np

from spinfilters.cli.main import main
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.io.measurement_log import MeasurementStream
from spinfilters.io.output_files import write_toml
from spinfilters.io.sensor_tables import write_covariance
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate

KINDS = {"stereo": "stereo-tracks", "unmapped": "stereo-tracks", "gyro": "gyro", "pose": "pose"}
COVARIANCES = {
    "stereo": "tracks_covariance.csv",
    "gyro": "gyro_covariance.csv",
    "pose": "poses_covariance.csv",
}
HEADER = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)","Absolute (rad/s)"'


def make_originals(folder: Path) -> None:
    """Write a folder of every kind, those of `COVARIANCES` also as "<kind>-covariance", "phone", "run" and "settings".

    "run" holds a finished run of the gyro with a prediction, below it the gyro as ``data``; "settings" a gyro as ``data`` with
    every setting in ``config.toml``.
    """
    for name, kind in KINDS.items():
        epochs, interval = (40, 0.1) if kind == "gyro" else (14, 0.5)
        scenario = Scenario.simplified(
            kind=kind, rate_rpm=RICH_RPM, epochs=epochs, interval=interval, landmarks=60, seed=3
        )
        write_dataset(simulate(scenario), folder / name)
    (folder / "unmapped" / "landmarks.csv").unlink()
    for name, file in COVARIANCES.items():
        shutil.copytree(folder / name, folder / f"{name}-covariance")
        (folder / name / file).unlink(missing_ok=True)
    _add_covariances(folder)
    _write_phone(folder / "phone")
    _write_run(folder / "run")
    write_dataset(
        simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=40, interval=0.1)),
        folder / "settings/data",
    )
    write_toml(
        folder / "settings/config.toml", {**Settings().document, "estimators": ["mekf", "ukf", "smoother"]}
    )


def _add_covariances(folder: Path) -> None:
    """To the gyro and the mapped tracks; poses come with theirs."""
    for name, file in (("gyro", "gyro"), ("stereo", "tracks")):
        table = np.loadtxt(folder / name / f"{file}.csv", delimiter=",", skiprows=1)
        ids = table[:, 1].astype(int) if name == "stereo" else None
        values = table[:, 2:] if name == "stereo" else table[:, 1:]
        covariance = np.tile(np.eye(3) * (1.0 if name == "stereo" else 4e-6), (len(table), 1, 1))
        stream = MeasurementStream(name, table[:, 0], values, ids, covariance)
        write_covariance(folder / f"{name}-covariance" / f"{file}_covariance.csv", stream)


def _write_phone(folder: Path) -> None:
    """A phyphox export of two kept segments and one that is no trial."""
    gyro = simulate(
        Scenario.simplified(kind="gyro", rate_rpm=(40.0, 90.0, 30.0), epochs=80, interval=0.02)
    ).log.streams[0]
    (folder / "meta").mkdir(parents=True)
    rows = [
        f"{time:.9E}," + ",".join(f"{rate:.9E}" for rate in (*rates, float(np.linalg.norm(rates))))
        for time, rates in zip(gyro.time, gyro.values, strict=True)
    ]
    (folder / "Raw Data.csv").write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    (folder / "meta/segments.csv").write_text(
        "segment,start,end,keep,comment\n0,,,false,noise\n1,0.1,0.8,,first\n2,0.8,1.5,,second\n",
        encoding="utf-8",
    )


def _write_run(folder: Path) -> None:
    data = simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=40, interval=0.1))
    write_dataset(data, folder / "data")
    made = [
        "compare",
        str(folder / "data"),
        "--estimators",
        "mekf",
        "--predict",
        "1",
        "-o",
        str(folder / "run"),
    ]
    assert main(made) == 0
