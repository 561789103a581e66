"""Small data sets and the text of their files, which the tests spoil one line at a time."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spinfilters.io.camera import PinholeCamera, StereoRig
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.io.sensor_tables import KnownMap
from spinfilters.io.truth import Truth

REAL_DATA = Path(__file__).parents[3] / "shared" / "data"
RIG = StereoRig(PinholeCamera(466.7, 466.8, 320.5, 240.25, 640, 480), baseline_m=0.0912345678901)

GYRO = "time_s,wx,wy,wz\n0.0,0.1,0.2,0.3\n0.01,0.1,0.2,0.3\n0.02,0.1,0.2,0.3\n"
TUM = "# timestamp tx ty tz qx qy qz qw\n0.0 0 0 1 0 0 0 1\n0.5 0 0 1 0 0 0 1\n1.0 0 0 1 0 0 0 1\n"
TRACKS = (
    "time_s,landmark_id,u_left_px,v_left_px,u_right_px\n"
    "0.0,1,300.0,200.0,230.0\n0.0,2,310.0,210.0,240.0\n0.5,1,301.0,200.0,231.0\n0.5,2,311.0,210.0,241.0\n"
)
TRUTH = (
    "time_s,rx,ry,rz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n"
    "0.0,0,0,1,0,0,0,1,0,0,0,0,0.1,0\n0.5,0,0,1,0,0,0,1,0,0,0,0,0.1,0\n"
)
LANDMARKS = "landmark_id,x,y,z\n1,0.1,0.2,0.3\n2,0.2,0.3,0.4\n"
DATASET = 'kind = "stereo-tracks"\ndescription = "two landmarks"\npixel_std = 1.0\n'
PHYPHOX = (
    '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)","Absolute (rad/s)"\n'
    + "".join(f"{0.01 * k:.9E},7.002363354E-2,5.4E-2,3.4E-2,9.4E-2\n" for k in range(100))
)
SEGMENTS = "segment,start,end,keep,comment\n0,,,false,noise\n1,0.1,0.4,,first\n2,0.5,0.9,,second"


def sensor_yaml(x: float = 0.0, **changed: str) -> str:
    """A sensor.yaml of the EuRoC layout, moved by x (m), with changed lines."""
    lines = {
        "T_BS": f"{{rows: 4, cols: 4, data: [1, 0, 0, {x}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}",
        "resolution": "[640, 480]",
        "camera_model": "pinhole",
        "intrinsics": "[466.7, 466.7, 320.0, 240.0]",
        "distortion_coefficients": "[0.0, 0.0, 0.0, 0.0]",
    }
    return "".join(f"{key}: {value}\n" for key, value in (lines | changed).items())


def stereo_folder(folder: Path) -> Path:
    """Write a stereo-tracks data set of two landmarks and two epochs, every optional file included."""
    files = {
        "dataset.toml": DATASET,
        "tracks.csv": TRACKS,
        "truth.csv": TRUTH,
        "truth.toml": "principal_moments = [1.0, 2.0, 2.5]\n",
        "landmarks.csv": LANDMARKS,
        "cam0/sensor.yaml": sensor_yaml(),
        "cam1/sensor.yaml": sensor_yaml(0.09),
    }
    return written(folder, files)


def phyphox_folder(folder: Path) -> Path:
    """Write a phyphox export of one second with two kept segments and one that is not a trial."""
    return written(folder, {"Raw Data.csv": PHYPHOX, "meta/segments.csv": SEGMENTS})


def written(folder: Path, files: dict[str, str]) -> Path:
    """Write the texts below the folder and return it."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def random_stereo(rng: np.random.Generator, frames: int = 7, landmarks: int = 5) -> MeasurementStream:
    """Stereo stream at irregular times, each epoch with every landmark, covariances included."""
    time = np.repeat(np.cumsum(rng.uniform(0.1, 0.6, frames)), landmarks)
    left = rng.uniform([100.0, 0.0], [640.0, 480.0], (time.size, 2))
    right = left[:, :1] - rng.uniform(5.0, 80.0, (time.size, 1))
    ids = np.concatenate([rng.permutation(landmarks) for _ in range(frames)])
    return MeasurementStream("stereo", time, np.hstack([left, right]), ids, spd(rng, time.size, 3))


def random_gyro(rng: np.random.Generator, rows: int = 40) -> MeasurementStream:
    """Gyro stream at irregular times."""
    return MeasurementStream("gyro", np.cumsum(rng.uniform(0.005, 0.02, rows)), rng.normal(size=(rows, 3)))


def random_pose(rng: np.random.Generator, rows: int = 30) -> MeasurementStream:
    """Pose stream with epoch time stamps and covariances."""
    time = 1.4e9 + np.cumsum(rng.uniform(0.01, 0.1, rows))
    values = np.hstack([rng.normal(size=(rows, 3)), Rotation.random(rows, rng=rng).as_quat()])
    return MeasurementStream("pose", time, values, None, spd(rng, rows, 6))


def random_truth(rng: np.random.Generator, rows: int = 20) -> Truth:
    """Truth with every mass property."""
    return Truth(
        time=np.cumsum(rng.uniform(0.1, 0.2, rows)),
        center_of_mass=rng.normal(size=(rows, 3)),
        q_ig=Rotation.random(rows, rng=rng).as_quat(),
        velocity=rng.normal(size=(rows, 3)),
        rate_i=rng.normal(size=(rows, 3)),
        principal_moments=np.array([1.0322, 1.0, 0.8596]),
        principal_axes_g=Rotation.random(rng=rng).as_matrix(),
        center_of_mass_g=rng.normal(size=3),
    )


def full_dataset(rng: np.random.Generator) -> Dataset:
    """A stereo-tracks data set of three sensors, with everything that a folder can hold."""
    return Dataset(
        kind="stereo-tracks",
        log=MeasurementLog((random_gyro(rng), random_pose(rng), random_stereo(rng))),
        description='three sensors, "quoted" and µ',
        truth=random_truth(rng),
        rig=RIG,
        known_map=KnownMap(np.array([7, 3, 11]), rng.normal(size=(3, 3))),
        options=DatasetOptions(
            pixel_std=0.7, gyro_noise_std=1e-3, frames="i: left camera", notes={"seed": 3}
        ),
    )


def spd(rng: np.random.Generator, count: int, dimension: int) -> np.ndarray:
    """Symmetric positive definite matrices (count, dimension, dimension), bitwise symmetric."""
    factor = rng.normal(size=(count, dimension, dimension))
    matrix = factor @ factor.transpose(0, 2, 1) + np.eye(dimension)
    return 0.5 * (matrix + matrix.transpose(0, 2, 1))
