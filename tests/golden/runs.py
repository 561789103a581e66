"""The golden runs: what is run, in the words of a shell.

They cover every kind of sensor with every kind of estimator, and what else writes numbers. Each is small; together they take a few
minutes on one core.
"""

from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True)
class GoldenRun:
    """One or several commands whose files are compared.

    Attributes
    ----------
    name : str
        Of the folder in which the commands run.
    commands : tuple of str
        Arguments of ``spinfilters``, run in order in that folder.
    files : dict
        Texts of files that the commands read, by name.
    keeps_output : bool
        Whether the last command's standard output is compared, too.
    """

    name: str
    commands: tuple[str, ...]
    files: dict[str, str] = field(default_factory=dict)
    keeps_output: bool = False


FAULTY_STUDY: Final = """\
[study]
name = "faults of poses"
seeds = 1
bound = "none"

[factors]
estimator = ["mekf", "smoother"]
"fault.model" = ["torque", "drag", "clock-jitter", "contact-at-end", "rotor"]

[motion.base]
rate_rpm = [4.0, 9.0, 3.0]
epochs = 50

[sensor.base]
kind = "pose"

[fault.base]
model_size = 3.0
"""

UNSTATED_STUDY: Final = """\
[study]
name = "unstated noise"
seeds = 1

[factors]
estimator = ["mekf", "smoother"]
"sensor.kind" = ["gyro", "pose", "stereo-tracks"]

[motion.base]
rate_rpm = [4.0, 9.0, 3.0]
epochs = 66

[body.base]
landmarks = 150

[noise.base]
stated = false
"""

CONSIDERED: Final = "[calibration]\nbaseline_std = 0.001\n"
BIASED_GYRO: Final = "[initialisation]\ngyro_bias_std = 0.02\n"

TUMBLING: Final = "--rate-rpm 3 10 4"
EVERY: Final = "--estimators mekf,ukf,smoother"
WITH_FILTERPY: Final = "--estimators mekf,ukf,smoother,filterpy-ekf,filterpy-ukf"


def comparison(kind: str, options: str = "", estimators: str = EVERY, simulated: str = "") -> tuple[str, ...]:
    """A simulated data set of 66 epochs and its comparison."""
    return (
        f"simulate -o data --kind {kind} --seed 4 --frames 66 {TUMBLING} {simulated}",
        f"compare data -o run {estimators} {options}",
    )


GOLDEN_RUNS: Final = (
    GoldenRun("tracks", comparison("stereo-tracks")),
    GoldenRun("tracks-known-map", comparison("stereo-tracks", "", WITH_FILTERPY, "--known-map")),
    GoldenRun("tracks-latest", comparison("stereo-tracks", "", "--estimators mekf,smoother-latest")),
    GoldenRun("tracks-convergence", comparison("stereo-tracks", "--convergence", "--estimators smoother")),
    GoldenRun("tracks-inspector", comparison("stereo-tracks", "", EVERY, "--inspector circle")),
    GoldenRun(
        "tracks-considered-calibration",
        comparison("stereo-tracks", "--config settings.toml", "--estimators mekf,smoother"),
        {"settings.toml": CONSIDERED},
    ),
    GoldenRun("one-camera", comparison("mono-tracks", "", WITH_FILTERPY, "--known-map")),
    GoldenRun("poses", comparison("pose", "--predict 3", WITH_FILTERPY)),
    GoldenRun("poses-explain", comparison("pose", "--explain", "--estimators mekf,smoother")),
    GoldenRun("poses-beside-gyro", comparison("pose", "", EVERY, "--beside gyro 0.1")),
    GoldenRun("attitudes", comparison("attitude", "", WITH_FILTERPY)),
    GoldenRun("gyro", comparison("gyro", "", WITH_FILTERPY)),
    GoldenRun("gyro-drag", comparison("gyro", "--drag")),
    GoldenRun(
        "gyro-bias",
        comparison("gyro", "--config settings.toml", EVERY, "--gyro-bias 0.01 -0.02 0.01"),
        {"settings.toml": BIASED_GYRO},
    ),
    GoldenRun("gyro-embedded", comparison("gyro", "", "--estimators embedded,embedded-double,mekf")),
    GoldenRun("lidar-points", comparison("lidar-points")),
    GoldenRun("lidar-poses", comparison("lidar-poses")),
    GoldenRun(
        "scans",
        (
            "lidar scan spacecraft --scans 8 --rays 60 60 --noise thesis --seed 2 -o data",
            "compare data -o run",
        ),
    ),
    GoldenRun(
        "images",
        (
            "simulate -o data --kind stereo-images --frames 6 --seed 1",
            "track data -o tracks",
            "compare tracks -o run --estimators smoother",
        ),
    ),
    GoldenRun("one-scan", ("lidar scan cube -o scan --rays 60 60 --noise jitter --seed 3",)),
    GoldenRun(
        "resume",
        (
            *comparison("pose", "", "--estimators mekf"),
            "compare data -o run --resume --estimators mekf --predict 2",
        ),
    ),
    GoldenRun(
        "live",
        (comparison("pose")[0], "live data --no-smoother --speed 2000 --deadline-ms 60000 --format tum"),
        keeps_output=True,
    ),
    GoldenRun("embed-pose", ("embed -o library --sensor pose",)),
    GoldenRun("embed-stereo", ("embed -o library --sensor stereo --landmarks 20",)),
    GoldenRun("observe", ("observe -o report --sensor stereo --frames 30",)),
    GoldenRun("observe-one-camera", ("observe -o report --sensor monocular --manoeuvre x --frames 30",)),
    GoldenRun("condition", ("condition -o report --time-step 0.5",)),
    GoldenRun("campaign-faults", ("campaign study.toml -o rows --workers 1",), {"study.toml": FAULTY_STUDY}),
    GoldenRun(
        "campaign-unstated", ("campaign study.toml -o rows --workers 1",), {"study.toml": UNSTATED_STUDY}
    ),
)
