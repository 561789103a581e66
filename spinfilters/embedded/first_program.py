"""What the program ``main.c`` of the embedded filter begins from and runs on: a start state, and a short recording."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.working_time import building
from spinfilters.embedded.embedded_options import EmbedOptions
from spinfilters.embedded.emitted_sensors import EmittedSensor
from spinfilters.embedded.model_functions import model_functions
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_blocks import ACCELERATION, GYRO_BIAS
from spinfilters.models.state_layout import Gaussian, StateLayout

PSD = (1e-6, 1e-6)
"""Disturbances of the start state: (m/s^2)^2/Hz and (rad/s^2)^2/Hz."""
EPOCHS = 60
TURN = 0.1
"""Rotation between two epochs of the recording, rad."""
LONGEST_INTERVAL = 0.1
"""Between two epochs of the recording, s."""
SEED = 29


@dataclass(frozen=True, eq=False)
class StartState:
    """A belief from which a generated filter begins.

    Attributes
    ----------
    mean : ndarray of shape (m,)
        State, in the order of the filter.
    covariance : ndarray of shape (n, n)
        Of its error.
    source : str
        Where it is from, for people.
    noise : Mapping[str, float]
        Of a run, by its options: densities of the disturbances, deviations of the sensors; what it lacks is that of the example.
    """

    mean: Float[np.ndarray, " m"]
    covariance: Float[np.ndarray, "n n"]
    source: str
    noise: Mapping[str, float] = field(default_factory=dict)

    @property
    def densities(self) -> tuple[float, float]:
        """Of the disturbances, (m/s^2)^2/Hz and (rad/s^2)^2/Hz."""
        return self.noise.get("force_psd", PSD[0]), self.noise.get("torque_psd", PSD[1])


def start_from_belief(
    belief: Gaussian, layout: StateLayout, source: str, noise: Mapping[str, float] = MappingProxyType({})
) -> StartState:
    """The start state of a filter's layout from a belief whose state has at least its blocks, with the noise of its run.

    Raises
    ------
    InputError
        The belief is not finite, or lacks a block of the filter's state.
    """
    missing = [name for name in layout.blocks if name not in belief.layout.blocks]
    if missing:
        cures = {
            GYRO_BIAS.name: "set initialisation.gyro_bias_std in the run",
            ACCELERATION.name: "set process.gravity = true in the run",
        }
        cure = cures.get(missing[0], "choose --sensor gyro, or a run of poses or tracks")
        raise InputError(
            f"{source}: its state has no {', '.join(missing)}, which this filter estimates; {cure}"
        )
    places = np.concatenate(
        [np.arange(belief.layout.error_dim)[belief.layout.slice(b)] for b in layout.blocks]
    )
    mean = np.concatenate([belief.mean[belief.layout.mean_slice(name)] for name in layout.blocks])
    covariance = belief.covariance[np.ix_(places, places)]
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        raise InputError(f"{source}: its last state is not finite; choose an estimator that did not fail")
    return StartState(mean, covariance, source, noise)


def program_texts(options: EmbedOptions, start: StartState) -> dict[str, str]:
    """``start_state.h`` and ``recording.h`` by name."""
    sensor = next(each for each in options.emitted if each.example is not None).with_noise(start.noise)
    ours = (
        "put the one of yours here" if not start.noise else "that of the run, where it states this sensor's"
    )
    interval, values = _recording(sensor, options.layout, start)
    columns = ",".join(
        column for block in options.layout.members for column in _columns(block.symbol, block.mean_size)
    )
    assert sensor.example is not None
    unused = "" if options.layout.translates else " (a state without a position does not use it)"
    begin = [
        f"/* Where the filter begins: {start.source}. In frame g; see README.md for the places of x. */",
        f'#define START_COLUMNS "{columns}"',
        c_array("start_x", start.mean),
        "/* Covariance of the error, row by row. */",
        c_array("start_covariance", start.covariance),
        f"/* Densities of the disturbances: of a force, (m/s^2)^2/Hz{unused}; of a torque over the inertia, (rad/s^2)^2/Hz. */",
        c_array("start_psd", np.array(start.densities)),
        f"/* Noise of the sensor, as its update takes it (spinfilter.h); {ours}. */",
        c_array("start_parameters", sensor.example),
    ]
    recorded = [
        f"/* A simulated recording ({sensor.name}) of a body that the start state describes; an epoch each {interval:.6g} s. */",
        f"#define RECORDING_EPOCHS {EPOCHS}",
        f"#define RECORDING_INTERVAL {interval:.9g}",
        c_array("recording", values),
    ]
    return {"start_state.h": "\n".join(begin) + "\n", "recording.h": "\n".join(recorded) + "\n"}


@building()
def operation_counts(options: EmbedOptions) -> dict[str, int]:
    """Arithmetic operations of a call of each generated function, by its name."""
    moves = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
    return {
        each.name(): sum(each.instruction_id(k) not in moves for k in range(each.n_instructions()))
        for each in model_functions(options)
    }


LICENCE = "Licence: MIT, (c) the spinfilters founders. SPDX-License-Identifier: MIT"


def with_licence(name: str, text: str) -> str:
    """A file's text with the line of its licence in the comment of its language; those that state it already as they are."""
    if name == "library.json":
        return text
    suffix = Path(name).suffix
    if suffix == ".md":
        return f"<!-- {LICENCE} -->\n\n{text}"
    if suffix == ".ini":
        return f"; {LICENCE}\n{text}"
    return f"/* {LICENCE} */\n{text}" if suffix in (".c", ".h", ".ld") else f"# {LICENCE}\n{text}"


def _recording(
    sensor: EmittedSensor, layout: StateLayout, start: StartState
) -> tuple[float, Float[np.ndarray, "k v"]]:
    """Interval in s, and noisy values of a truth that is drawn from the start state."""
    rng = np.random.default_rng(SEED)
    root = np.linalg.cholesky(start.covariance + 1e-18 * np.eye(layout.error_dim))
    truth = layout.retract(start.mean, root @ rng.normal(size=layout.error_dim))
    rate = float(np.linalg.norm(truth[layout.mean_slice("w")]))
    interval = min(LONGEST_INTERVAL, TURN / rate) if rate > 0 else LONGEST_INTERVAL
    process, model = TorqueFreeProcess(layout, ProcessNoise(*start.densities), 1e-12), sensor.model(layout)
    assert sensor.example is not None
    values: list[np.ndarray] = []
    for epoch in range(EPOCHS):
        if epoch:
            truth = process.step(truth, interval)
        exact = model.predict(truth, sensor.example)
        values.append(sensor.normalised(exact + np.array(sensor.example_std) * rng.normal(size=len(exact))))
    return interval, np.array(values)


def _columns(symbol: str, size: int) -> list[str]:
    """Column names of a block: letters of axes, numbers for the mass distribution."""
    ends = "xyzw" if size <= 4 else "12345"
    return [symbol + end for end in ends[:size]]


def c_array(name: str, array: Float[np.ndarray, "..."], cast: str = "(sf_real)") -> str:
    """A constant array of C, six numbers a line."""
    numbers = [f"{cast}{value:.17g}" for value in np.asarray(array, dtype=float).ravel()]
    rows = [", ".join(numbers[k : k + 6]) for k in range(0, len(numbers), 6)]
    return f"static const sf_real {name}[] = {{\n  " + ",\n  ".join(rows) + "};"
