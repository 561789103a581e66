"""Folder of the embedded filter: its C, its documentation, and test vectors from the Python reference."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.mass_distribution import from_inertia
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.emitted_sensors import EmittedSensor
from spinfilters.embedded.first_program import (
    StartState,
    c_array,
    operation_counts,
    program_texts,
    with_licence,
)
from spinfilters.embedded.library import library_texts, template
from spinfilters.filters.landmark_map import CONFIRMED, WRONG_IN_A_ROW
from spinfilters.filters.outlier_rejection import RobustOptions, gate
from spinfilters.io.output_files import write_text
from spinfilters.models.camera_landmarks import camera_parameters
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_blocks import ACCELERATION, GYRO_BIAS, POSITION
from spinfilters.models.state_layout import StateLayout


@dataclass
class OwnLandmark:
    """A landmark with a covariance of its own: point (3,) m, covariance (3, 3) m^2."""

    point: Float[np.ndarray, " 3"]
    covariance: Float[np.ndarray, "3 3"]
    hits: int = CONFIRMED
    wrong: int = 0


class ReferenceFilter:
    """State and covariance, and landmarks with independent errors; a bias of the gyro may walk.

    An observation of a landmark corrects the pose with the landmark's covariance in its noise. The landmark is then moved from that
    pose, whose covariance goes into its own.

    Attributes
    ----------
    mean : ndarray of shape (m,)
        Point.
    covariance : ndarray of shape (n, n)
    landmarks : dict[int, OwnLandmark]
        By place in the map.
    """

    def __init__(
        self,
        process: TorqueFreeProcess,
        mean: Float[np.ndarray, " m"],
        covariance: Float[np.ndarray, "n n"],
        gyro_bias_psd: float = 0.0,
    ) -> None:
        self.process, self.layout, self.gyro_bias_psd = process, process.layout, gyro_bias_psd
        self.mean, self.covariance = mean.copy(), covariance.copy()
        self.landmarks: dict[int, OwnLandmark] = {}

    def predict(self, dt: float) -> None:
        """Predict dt seconds ahead."""
        self.mean, transition, noise = self.process.linearise(self.mean, dt)
        self.covariance = transition @ self.covariance @ transition.T + noise @ noise.T
        if self.gyro_bias_psd:
            bias = self.layout.slice(GYRO_BIAS.name)
            self.covariance[bias, bias] += self.gyro_bias_psd * dt * np.eye(GYRO_BIAS.dimension)

    def update(
        self, model: MeasurementModel, value: Float[np.ndarray, " v"], parameters: Float[np.ndarray, " p"]
    ) -> bool:
        """Update with one value of a sensor without landmarks; False outside the gate."""
        found = model.linearise(self.mean, parameters[None], value[None])
        H = np.zeros((model.dim, self.layout.error_dim))
        H[:, model.columns] = found.jacobian[0]
        if _distance(H, found.innovation[0], self.covariance) > _limit(model.dim):
            return False
        self._correct(H, found.innovation[0])
        return True

    def observe(
        self,
        model: LandmarkSensor,
        values: Float[np.ndarray, "k 3"],
        camera: Float[np.ndarray, " c"],
        places: Int[np.ndarray, " k"],
    ) -> None:
        """Update with all observations of an epoch."""
        rows, pose = [], self.covariance[np.ix_(model.columns, model.columns)]
        used: dict[int, bool | None] = {}
        for value, place in zip(values, places.tolist(), strict=True):
            landmark = self.landmarks.get(place)
            if landmark is None:
                continue
            rho, H, by_landmark, valid = self._linearised(model, landmark.point, value, camera)
            L = np.linalg.cholesky(by_landmark @ landmark.covariance @ by_landmark.T + np.eye(3))
            rho, H = np.linalg.solve(L, rho), np.linalg.solve(L, H)
            good = _distance(H, rho, pose) <= _limit(3)
            used[place] = good if valid else None
            if valid and good:
                rows.append((rho, H))
        if rows:
            H = np.zeros((3 * len(rows), self.layout.error_dim))
            H[:, model.columns] = np.concatenate([row for _, row in rows])
            self._correct(H, np.concatenate([rho for rho, _ in rows]))
        for value, place in zip(values, places.tolist(), strict=True):
            self._keep_house(model, value, camera, place, used.get(place))

    def _keep_house(
        self,
        model: LandmarkSensor,
        value: Float[np.ndarray, " 3"],
        camera: Float[np.ndarray, " c"],
        place: int,
        used: bool | None,
    ) -> None:
        landmark, pose = self.landmarks.get(place), self.covariance[np.ix_(model.columns, model.columns)]
        if landmark is not None:
            if used is None:
                return
            if used:
                self._move(model, landmark, value, camera)
                return
            landmark.wrong += 1
            if landmark.hits >= CONFIRMED and landmark.wrong < WRONG_IN_A_ROW:
                return
            del self.landmarks[place]
        made = model.new_landmarks(self.mean, np.concatenate([np.zeros(3), camera])[None], value[None])
        if made.determined[0]:
            by_pose, root = made.jacobian[0], made.root[0]
            covariance = by_pose @ pose @ by_pose.T + root @ root.T
            self.landmarks[place] = OwnLandmark(made.points[0], covariance, 1)

    def _move(
        self,
        model: LandmarkSensor,
        landmark: OwnLandmark,
        value: Float[np.ndarray, " 3"],
        camera: Float[np.ndarray, " c"],
    ) -> None:
        """Correction of the landmark by an observation, given the pose after the epoch."""
        pose = self.covariance[np.ix_(model.columns, model.columns)]
        rho, H, by_landmark, _ = self._linearised(model, landmark.point, value, camera)
        spread = landmark.covariance @ by_landmark.T
        gain = np.linalg.solve(by_landmark @ spread + np.eye(3), spread.T).T
        pulled = gain @ H
        landmark.point = landmark.point + gain @ rho
        landmark.covariance = landmark.covariance - gain @ spread.T + pulled @ pose @ pulled.T
        landmark.hits, landmark.wrong = landmark.hits + 1, 0

    def _linearised(
        self,
        model: LandmarkSensor,
        point: Float[np.ndarray, " 3"],
        value: Float[np.ndarray, " 3"],
        camera: Float[np.ndarray, " c"],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        parameters = np.concatenate([point, camera])[None]
        found = model.linearise_landmarks(self.mean, parameters, value[None])
        return found.innovation[0], found.jacobian[0], found.by_landmark[0], bool(found.valid[0])

    def _correct(self, H: Float[np.ndarray, "k n"], rho: Float[np.ndarray, " k"]) -> None:
        information = np.linalg.inv(self.covariance) + H.T @ H
        P = np.linalg.inv((information + information.T) / 2)
        error = P @ (H.T @ rho)
        J = self.layout.reset_jacobian(error)
        self.mean = self.layout.retract(self.mean, error)
        self.covariance = J @ ((P + P.T) / 2) @ J.T


def _distance(
    H: Float[np.ndarray, "d n"], rho: Float[np.ndarray, " d"], P: Float[np.ndarray, "n n"]
) -> float:
    return float(rho @ np.linalg.solve(H @ P @ H.T + np.eye(len(rho)), rho))


def _limit(dof: int) -> float:
    return gate(RobustOptions().gate_probability, dof)


TEST = ("test_spinfilter.c", "test_spinfilter.h", "firmware.c", "firmware.ld", "Makefile")
PROGRAM = ("main.c", "CMakeLists.txt", "library.json", "platformio.ini")
BYTES = {"float": 4, "double": 8}


def folder_texts(options: EmbedOptions, start: StartState | None = None) -> dict[str, str]:
    """Texts of all files by name; without a start state that of an example."""
    begin = example_start(options) if start is None else start
    texts = library_texts(options) | {name: template(name) for name in (*TEST, *PROGRAM)}
    texts |= program_texts(options, begin)
    texts["test_vectors.h"] = make_vectors(options).text()
    texts["README.md"] = readme_text(options, begin.source)
    return {name: with_licence(name, text) for name, text in texts.items()}


def write_library(options: EmbedOptions, folder: Path, start: StartState | None = None) -> list[Path]:
    """Write the folder, which exists; the files written."""
    texts = folder_texts(options, start)
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def memory_sizes(options: EmbedOptions) -> dict[str, int]:
    """Bytes of what a filter keeps, by what it is."""
    layout, size = options.layout, BYTES[options.real]
    n = layout.error_dim
    sizes = {"`sf_filter`": size * (layout.mean_dim + n * (n - 1) // 2 + n + 3) + 8}
    if options.has_map:
        sizes[f"map of {options.landmarks} landmarks"] = options.landmarks * (9 * size + 4)
    return sizes


_UPDATES: Final = {
    "gyro": "sf_update_gyro(&filter, rates, start_parameters);  /* rad/s, axes g */",
    "pose": "sf_update_pose(&filter, pose, start_parameters);   /* x, y, z (m), q_ig */",
    "stereo": "sf_update_stereo(&filter, map, observations, count, camera);",
}
"""Of the README's loop, by the sensor of the filter."""
_MAP: Final = """**Stereo.** `camera` is fx, fy, cx, cy (px), baseline (m), pixel_std (px). You own `map`; set it to zero at first.
An observation names a place in the map, and an empty place becomes a landmark at its first observation.

"""


def readme_text(options: EmbedOptions, source: str) -> str:
    """``README.md``, with the source of the start state."""
    layout = options.layout
    rows = [f"| {what} | {size} bytes |" for what, size in memory_sizes(options).items()]
    operations = [f"| `{name}` | {count} |" for name, count in operation_counts(options).items()]
    values = {
        "source": source,
        "operations": "\n".join(operations),
        "substeps": str(options.substeps),
        "options": f"sensor {options.sensor}, {options.real}, {options.substeps} substeps"
        + further_options(options),
        "estimated": "pose, velocities, centre of mass and inertia ratios"
        if layout.has(POSITION)
        else "attitude, body rate and inertia ratios",
        "blocks": further_blocks(options),
        "sizes": "\n".join(rows),
        "state": ", ".join(f"`{block.symbol}` ({block.mean_size})" for block in layout.members),
        "turn": f"{0.08 * options.substeps:.2f}",
        "update": _UPDATES[options.sensor],
        "map": _MAP if options.has_map else "",
    }
    text = template("README.md")
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", value)
    return text


def further_options(options: EmbedOptions) -> str:
    """Blocks of the state that the options add, for the first sentence of the README; "" without any."""
    text = ", gyro bias" if options.gyro_bias_std else ""
    if options.gyro_bias_psd:
        text += f" that walks by {options.gyro_bias_psd:.3g} (rad/s^2)^2/Hz"
    return text + (", constant acceleration" if options.acceleration else "")


def further_blocks(options: EmbedOptions) -> str:
    """Sentences of the README on the blocks of the state that the options add; "" without any."""
    text = ""
    if options.gyro_bias_std:
        walk = "its variance grows by `SF_GYRO_BIAS_PSD` (`spinfilter_config.h`) a second"
        kind = walk if options.gyro_bias_psd else "it is constant"
        text += f"\n`b` is the bias of the gyro, rad/s in axes g; {kind}."
    if options.acceleration:
        text += "\n`f` is the constant acceleration of the centre of mass, m/s^2 in axes i."
    return text


EPOCHS, INTERVAL = 6, 0.1
OBSERVATIONS = 200
RATE = (0.1, 1.05, 0.05)
BIAS, PULL = (0.012, -0.008, 0.005), (0.001, -0.003, 0.002)
"""Of the gyro in rad/s, and constant acceleration in m/s^2, of the example body where the state has them."""
CALIBRATION = (500.0, 500.0, 320.0, 240.0, 0.1)
STD = {"t": 0.004, "a": 0.01, "v": 0.004, "w": 0.02, "c": 0.02, "s": 0.2, "b": 0.01, "f": 0.002}
SEED = 17


@dataclass(frozen=True)
class TestVectors:
    """Inputs and outputs of a filter, epoch by epoch, as named arrays."""

    __test__ = False  # no test class, whatever its name
    arrays: dict[str, Float[np.ndarray, "..."]]

    def text(self) -> str:
        """``test_vectors.h``."""
        lines = ["/* Generated from the Python reference. */", f"#define EPOCHS {EPOCHS}"]
        lines.append(f"#define INTERVAL {INTERVAL}")
        lines += [c_array(f"vector_{name}", array, cast="") for name, array in self.arrays.items()]
        return "\n".join(lines) + "\n"


def make_vectors(options: EmbedOptions) -> TestVectors:
    """Vectors of the sensors that the options ask for; the same for either precision."""
    rng, layout = np.random.default_rng(SEED), options.layout
    process = TorqueFreeProcess(layout, ProcessNoise(1e-6, 1e-6), 1e-12)
    std = np.concatenate([np.full(block.dimension, STD[block.name]) for block in layout.members])
    truth = _first(options)
    x = layout.retract(truth, std * rng.normal(size=layout.error_dim))
    reference = ReferenceFilter(process, x, np.diag(std**2), options.gyro_bias_psd)
    arrays = {"x": x, "covariance": reference.covariance.copy(), "psd": np.array([1e-6, 1e-6])}
    sensor = (
        _Landmarks(options, arrays, rng) if options.has_map else _OneValue(options.emitted[0], layout, arrays)
    )
    out: list[np.ndarray] = []
    for _ in range(EPOCHS):
        truth = process.step(truth, INTERVAL)
        reference.predict(INTERVAL)
        sensor.measure(reference, truth, rng)
        out.append(np.concatenate([reference.mean, np.sqrt(np.diag(reference.covariance))]))
    arrays["expected"] = np.array(out)
    return TestVectors(arrays | sensor.finished())


class _OneValue:
    """One value an epoch, of a sensor without landmarks."""

    def __init__(self, sensor: EmittedSensor, layout: StateLayout, arrays: dict[str, np.ndarray]) -> None:
        assert sensor.example is not None
        self._sensor, self._model, self._parameters = sensor, sensor.model(layout), sensor.example
        arrays["parameters"] = self._parameters
        self._values: list[np.ndarray] = []

    def measure(self, reference: ReferenceFilter, truth: np.ndarray, rng: np.random.Generator) -> None:
        """Take one noisy pose or rate from the true state and update."""
        expected = self._model.predict(truth, self._parameters)
        value = self._sensor.normalised(expected + 0.003 * rng.normal(size=len(expected)))
        self._values.append(value)
        assert reference.update(self._model, value, self._parameters)

    def finished(self) -> dict[str, np.ndarray]:
        """Test-vector arrays: the measured values."""
        return {"values": np.array(self._values)}


class _Landmarks:
    """Stereo landmarks on the near side of a ball; every other one is known at the start."""

    def __init__(
        self, options: EmbedOptions, arrays: dict[str, np.ndarray], rng: np.random.Generator
    ) -> None:
        (self._model,) = (
            each.landmark_model(options.layout) for each in options.emitted if each.landmark_model
        )
        count = min(OBSERVATIONS, options.landmarks)
        normals = rng.normal(size=(count, 3))
        normals[:, 2] = -np.abs(normals[:, 2])
        self._points = 0.1 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self._camera = camera_parameters(np.zeros((1, 3)), np.array(CALIBRATION), 1.0)[0, 3:]
        self._known = np.arange(0, count, 2)
        self._start = self._points + 0.001 * rng.normal(size=self._points.shape)
        arrays["camera"] = self._camera
        arrays["known"] = self._start[self._known]
        arrays["known_covariance"] = np.array([1e-6, 0, 1e-6, 0, 0, 1e-6])
        self._values: list[np.ndarray] = []

    def measure(self, reference: ReferenceFilter, truth: np.ndarray, rng: np.random.Generator) -> None:
        """Take noisy stereo observations from the true state and update."""

        if not self._values:
            for place in self._known.tolist():
                reference.landmarks[place] = OwnLandmark(self._start[place].copy(), 1e-6 * np.eye(3))
        count = len(self._points)
        parameters = np.concatenate([self._points, np.tile(self._camera, (count, 1))], axis=1)
        pixels = self._model.predict(truth, parameters) + rng.normal(size=(count, 3))
        if len(self._values) == 2:
            pixels[:5] += 40.0  # wrong associations
        self._values.append(pixels)
        reference.observe(self._model, pixels, self._camera, np.arange(count))
        self._landmarks = reference.landmarks

    def finished(self) -> dict[str, np.ndarray]:
        """Test-vector arrays: values, and the last landmarks (m, frame g)."""
        last = [self._landmarks[place].point for place in range(len(self._points))]
        return {"values": np.array(self._values), "points": np.array(last)}


def example_start(options: EmbedOptions) -> StartState:
    """A start state of the example body of the test vectors."""
    stated = STD | {GYRO_BIAS.name: options.gyro_bias_std}
    std = np.concatenate([np.full(block.dimension, stated[block.name]) for block in options.layout.members])
    return StartState(_first(options), np.diag(std**2), "an example body")


def _first(options: EmbedOptions) -> Float[np.ndarray, " m"]:
    layout = options.layout
    x = layout.origin()
    x[layout.mean_slice("w")] = RATE
    x[layout.mean_slice("s")] = from_inertia(np.diag([1.03, 1.0, 0.86]))
    if layout.translates:
        x[layout.mean_slice("t")] = (0.01, -0.02, 0.6)
        x[layout.mean_slice("v")] = (0.002, 0.001, -0.001)
        x[layout.mean_slice("c")] = (0.02, -0.015, 0.01)
    if layout.has(GYRO_BIAS):
        x[layout.mean_slice(GYRO_BIAS.name)] = BIAS
    if layout.has(ACCELERATION):
        x[layout.mean_slice(ACCELERATION.name)] = PULL
    return x
