"""How well any system is determined: Fisher information and Cramer-Rao bound along a trajectory, with the user's noise and priors.

The unknowns z are all states, the unknown inputs (as random walks) and the parameters. A square root R of their information,
R' R = I, is carried along the true trajectory: an output with standard deviation s adds the row (dh/dz)/s, process noise is
marginalised by QR (Bierman 1977, Factorization Methods, ch. VI). Without any prior R may be singular; its null directions are then
what the measurements do not determine.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import qr

from observability.cramer_rao import WIDENING, predicted_root, prior_share
from observability.model import Model, model_of
from observability.prior_dependence import PRIOR_ONLY
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError

STEPS: Final = 4
"""Runge-Kutta steps between two times."""
SINGULAR: Final = 1e-9
"""Singular values of the scaled root below this share of the largest are 0."""

Course = Callable[[float], float] | Sequence[float] | Float[np.ndarray, " t"] | float
"""A known input: a function of time, its values at the times (linear in between), or a constant."""


class LinearisedTime(NamedTuple):
    """Motion to a time and measurements at it, linear about the true trajectory.

    Attributes
    ----------
    transition : ndarray of shape (n, n)
        From the time before.
    entry : ndarray of shape (n, q)
        By which process noise of unit variance enters on the way, q independent ones.
    rows : ndarray of shape (m, n)
        Slopes of the outputs that are measured then, each in its standard deviation.
    """

    transition: Float[np.ndarray, "n n"]
    entry: Float[np.ndarray, "n q"]
    rows: Float[np.ndarray, "m n"]


@dataclass(frozen=True)
class Experiment:
    """One flight of a model with everything that its bound depends on.

    Attributes
    ----------
    model : Model
        The equations.
    values : Mapping[str, float]
        True states at the first time, parameters, known constants, unknown inputs.
    times : ndarray of shape (t,)
        Of the measurements, s; the first is the time of the initial state.
    noise : Mapping[str, float]
        Standard deviation of each output that is measured.
    priors : Mapping[str, float]
        Standard deviations of states at the first time, parameters and unknown inputs; without one nothing is known.
    process_noise : Mapping[str, float]
        Power spectral density (unit^2/s) of the noise in the rate of a state or unknown input.
    inputs : Mapping[str, Course]
        Known inputs.
    every : Mapping[str, int]
        An output measured at every so many times only.
    """

    model: Model
    values: Mapping[str, float]
    times: Float[np.ndarray, " t"]
    noise: Mapping[str, float]
    priors: Mapping[str, float]
    process_noise: Mapping[str, float]
    inputs: Mapping[str, Course]
    every: Mapping[str, int]

    def __post_init__(self) -> None:
        model = self.model
        needed = [*model.states, *model.parameters, *model.known_constants, *model.unknown_inputs]
        for what, given, allowed, lacking in (
            ("values", self.values, needed, needed),
            ("inputs", self.inputs, [*model.inputs], [*model.inputs]),
            ("noise", self.noise, [*model.outputs], []),
            ("priors", self.priors, [*self.names], []),
            ("process_noise", self.process_noise, [*model.states, *model.unknown_inputs], []),
            ("every", self.every, [*model.outputs], []),
        ):
            foreign = [name for name in given if name not in allowed]
            if foreign:
                raise InputError(
                    f"{model.name}: {what} names {foreign[0]!r}, which is not there; use {', '.join(allowed) or 'none'}"
                )
            missing = [name for name in lacking if name not in given]
            if missing:
                raise InputError(f"{model.name}: {what} has no {missing[0]!r}; give it a number")
        for what, numbers in (("noise", self.noise), ("priors", self.priors), ("every", self.every)):
            wrong = [name for name, each in numbers.items() if not each > 0]
            if wrong:
                raise InputError(
                    f"{model.name}: {what} of {wrong[0]} is {numbers[wrong[0]]}; give a positive number"
                )
        if not self.noise:
            raise InputError(f"{model.name}: nothing is measured; give noise, a standard deviation by output")
        if len(self.times) < 2 or not (np.diff(self.times) > 0).all():
            raise InputError(f"{model.name}: times have to increase, and be at least two")

    @property
    def names(self) -> tuple[str, ...]:
        """States, unknown inputs, parameters: the order of all arrays."""
        return (*self.model.states, *self.model.unknown_inputs, *self.model.parameters)

    @cached_property
    def flow(self) -> Compiled:
        """(z, Phi, P, u, constants) -> their rates."""
        z, u, c = self._symbols
        size, rates = z.numel(), self._rates
        slope = ca.jacobian(rates, z)
        phi, cov = ca.SX.sym("phi", size, size), ca.SX.sym("cov", size, size)
        density = ca.diag(ca.DM([self.process_noise.get(name, 0.0) for name in self.names]))
        grown = slope @ cov
        out = [rates, slope @ phi, grown + grown.T + density]
        return Compiled.interpreted(ca.Function("flow", [z, phi, cov, u, c], out))

    @cached_property
    def sensing(self) -> Compiled:
        """(z, u, constants) -> outputs and their Jacobian."""
        z, u, c = self._symbols
        outputs = ca.vertcat(*self.model.outputs.values())
        return Compiled.interpreted(ca.Function("sensing", [z, u, c], [outputs, ca.jacobian(outputs, z)]))

    @property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        symbols = self.model.symbols
        groups = (self.names, self.model.inputs, self.model.known_constants)
        z, u, c = (ca.vertcat(ca.SX(0, 1), *[symbols[name] for name in group]) for group in groups)
        return z, u, c

    @property
    def _rates(self) -> ca.SX:
        still = [ca.SX(0)] * (len(self.names) - len(self.model.states))
        return ca.vertcat(*self.model.rates.values(), *still)

    def input_values(self, time: float) -> Float[np.ndarray, " u"]:
        """Known inputs at a time."""
        found = []
        for name in self.model.inputs:
            course = self.inputs[name]
            if callable(course):
                found.append(float(course(time)))
            else:
                values = np.broadcast_to(np.asarray(course, dtype=float), self.times.shape)
                found.append(float(np.interp(time, self.times, values)))
        return np.array(found)

    def step(
        self, z: Float[np.ndarray, " n"], first: float, last: float
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]]:
        """z at the next time, the transition to it, and the covariance of the process noise in between."""
        c = np.array([float(self.values[name]) for name in self.model.known_constants])
        now = (z, np.eye(len(z)), np.zeros((len(z), len(z))))
        width = (last - first) / STEPS
        for k in range(STEPS):
            t, slopes = first + k * width, []
            for shift, weight in ((0.0, 0.0), (0.5, 0.5), (0.5, 0.5), (1.0, 1.0)):
                at = (
                    now
                    if not slopes
                    else tuple(a + weight * width * b for a, b in zip(now, slopes[-1], strict=True))
                )
                slopes.append(self.flow(*at, self.input_values(t + shift * width), c))
            now = tuple(
                a + width / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                for a, k1, k2, k3, k4 in zip(now, *slopes, strict=True)
            )
        return now[0], now[1], now[2]

    def sensed(
        self, z: Float[np.ndarray, " n"], time: float
    ) -> tuple[Float[np.ndarray, " o"], Float[np.ndarray, "o n"]]:
        """Outputs and their Jacobian."""
        c = np.array([float(self.values[name]) for name in self.model.known_constants])
        values, slopes = self.sensing(z, self.input_values(time), c)
        return values, slopes

    @cached_property
    def linearised(self) -> tuple[LinearisedTime, ...]:
        """Motion and measurements at every time about the true trajectory, which is integrated once for all priors.

        Raises
        ------
        InputError
            The trajectory, or a slope along it, is not finite.
        """
        z, size, found = self.start(), len(self.names), []
        transition, noise = np.eye(size), np.zeros((size, size))
        for k, time in enumerate(self.times.tolist()):
            if k:
                z, transition, noise = self.step(z, float(self.times[k - 1]), time)
            _, slopes = self.sensed(z, time)
            rows = [
                slopes[index] / self.noise[name]
                for index, name in enumerate(self.model.outputs)
                if name in self.noise and k % self.every.get(name, 1) == 0
            ]
            if not all(np.isfinite(each).all() for each in (transition, noise, *rows)):
                raise InputError(
                    f"{self.model.name}: the trajectory leaves the numbers at t = {time:g} s; check values and times"
                )
            sizes, axes = np.linalg.eigh(noise)
            kept = sizes > 1e-14 * max(sizes[-1], 0.0)
            entry = axes[:, kept] * np.sqrt(sizes[kept])
            found.append(LinearisedTime(transition, entry, np.array(rows).reshape(-1, size)))
        return tuple(found)

    def start(self) -> Float[np.ndarray, " n"]:
        """True unknowns at the first time."""
        return np.array([float(self.values[name]) for name in self.names])


@dataclass(frozen=True)
class ModelBound:
    """Cramer-Rao bound of all unknowns at every time; printed, a table.

    Attributes
    ----------
    experiment : Experiment
        What was asked.
    roots : ndarray of shape (t, n, n)
        Square roots of the information at every time, with all measurements up to it.
    """

    experiment: Experiment
    roots: Float[np.ndarray, "t n n"]

    @property
    def names(self) -> tuple[str, ...]:
        """States, unknown inputs, parameters."""
        return self.experiment.names

    @cached_property
    def covariances(self) -> Float[np.ndarray, "t n n"]:
        """Bounds of the covariance; infinite where the information is singular."""
        return np.stack([_covariance(root) for root in self.roots])

    @property
    def std(self) -> Float[np.ndarray, "t n"]:
        """Smallest possible standard deviations at every time."""
        return np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))

    @property
    def final(self) -> dict[str, float]:
        """Smallest possible standard deviations at the last time, by name of the unknown."""
        return dict(zip(self.names, self.std[-1].tolist(), strict=True))

    @cached_property
    def prior_only(self) -> list[dict[str, float]]:
        """Directions in deviations of the priors (1 where there is none) that the measurements hardly improve.

        A direction of information p of the prior and d of the data keeps the share sqrt(p / (p + d)); priors ten times as wide show
        the share (`WIDENING`). Without a prior, a direction of no information.
        """
        scale = np.array([self.experiment.priors.get(name, 1.0) for name in self.names])
        wide = {name: WIDENING * each for name, each in self.experiment.priors.items()}
        narrow = self.roots[-1] * scale
        if not wide:
            shares, directions = _null_shares(narrow)
        else:
            other = information_roots(self.experiment, wide)[-1] * scale
            shares, directions = _growth(narrow, other)
        found = [directions[:, k] for k in np.flatnonzero(shares >= PRIOR_ONLY)]
        return [
            {
                name: float(part)
                for name, part in zip(self.names, each / np.abs(each).max(), strict=True)
                if abs(part) > 0.05 * np.abs(each).max()
            }
            for each in found
        ]

    def __str__(self) -> str:
        last = self.experiment.times[-1]
        lines = [f"{self.experiment.model.name}: Cramer-Rao bound at t = {last:g} s, standard deviations:"]
        for name, value in self.final.items():
            lines.append(f"  {name:20} {value:.4g}" if np.isfinite(value) else f"  {name:20} not determined")
        unit = ", in deviations of the priors" if self.experiment.priors else ""
        for each in self.prior_only:
            words = " ".join(f"{part:+.3g} {name}" for name, part in each.items())
            lines.append(f"Not determined by the measurements{unit}: {words}.")
        return "\n".join(lines)

    def document(self) -> dict[str, Any]:
        """The bound for JSON; what is infinite is null."""
        return {
            "model": self.experiment.model.name,
            "times": self.experiment.times.tolist(),
            "std": {
                name: [float(each) if np.isfinite(each) else None for each in self.std[:, k]]
                for k, name in enumerate(self.names)
            },
            "prior_only": self.prior_only,
        }


def bound(
    model: Mapping[str, Any],
    values: Mapping[str, float],
    noise: Mapping[str, float],
    times: Sequence[float] | Float[np.ndarray, " t"],
    priors: Mapping[str, float] | None = None,
    process_noise: Mapping[str, float] | None = None,
    inputs: Mapping[str, Course] | None = None,
    every: Mapping[str, int] | None = None,
) -> ModelBound:
    """How well measurements can determine a model's states and parameters along a trajectory.

    Parameters
    ----------
    model : Mapping
        A dictionary of formulas, as of `analyse`; for CasADi expressions see `bound_of`.
    values : Mapping[str, float]
        True states at the first time, parameters, known constants and unknown inputs.
    noise : Mapping[str, float]
        Standard deviation of each output that is measured; others are left out.
    times : array of shape (t,)
        Of the measurements, s, for example those of a recording.
    priors, process_noise, inputs, every : Mapping
        See `Experiment`.

    Raises
    ------
    InputError
        One line with the name and the cure.

    Examples
    --------
    >>> from observability import bound
    >>> place = {"states": ["x"], "equations": {"x": 0}, "outputs": {"y": "x"}}
    >>> bound(place, {"x": 1.0}, {"y": 0.2}, [0.0, 1.0, 2.0, 3.0]).final
    {'x': 0.1}
    """
    experiment = Experiment(
        model_of(model),
        dict(values),
        np.asarray(times, dtype=float),
        dict(noise),
        dict(priors or {}),
        dict(process_noise or {}),
        dict(inputs or {}),
        dict(every or {}),
    )
    return bound_of(experiment)


def bound_of(experiment: Experiment) -> ModelBound:
    """The bound of an experiment, whose model may be of CasADi expressions."""
    return ModelBound(experiment, information_roots(experiment, experiment.priors))


def information_roots(experiment: Experiment, priors: Mapping[str, float]) -> Float[np.ndarray, "t n n"]:
    """Square roots of the information at every time, with the measurements of that time."""
    root = np.diag([1 / priors[name] if name in priors else 0.0 for name in experiment.names])
    found = []
    for k, (transition, entry, rows) in enumerate(experiment.linearised):
        if k:
            root = predicted_root(transition, entry, root)
        root = _triangle(np.vstack([root, rows]), len(root))
        found.append(root)
    return np.stack(found)


def gain_table(
    found: ModelBound, manoeuvres: Mapping[str, Mapping[str, Course]] | None = None
) -> dict[str, dict[str, float]]:
    """Gain of each sensor and manoeuvre: standard deviations at the last time without over with it, by unknown.

    Parameters
    ----------
    found : ModelBound
        With all sensors.
    manoeuvres : Mapping
        By name the known inputs that take the place of those of the experiment.

    Returns
    -------
    dict
        By sensor or manoeuvre, then by unknown; infinity where the unknown is determined by it alone.
    """
    own, table = found.experiment, {}
    for name in own.noise:
        others = {key: each for key, each in own.noise.items() if key != name}
        table[name] = _ratios(
            bound_of(replace(own, noise=others)).final if others else dict.fromkeys(own.names, np.inf),
            found.final,
        )
    for name, inputs in (manoeuvres or {}).items():
        moved = bound_of(replace(own, inputs={**own.inputs, **inputs}))
        table[name] = _ratios(found.final, moved.final)
    return table


def _ratios(without: Mapping[str, float], with_it: Mapping[str, float]) -> dict[str, float]:
    """1 where both are infinite."""
    return {name: float(without[name] / each) if np.isfinite(each) else 1.0 for name, each in with_it.items()}


def empirical_information(found: ModelBound, share: float = 1e-4) -> Float[np.ndarray, "n n"]:
    """Information about the unknowns at the first time by finite moves: the empirical Gramian over the noise.

    Every unknown is moved there and back by a share of its prior (of itself, or 1), the outputs are simulated, and differences
    squared and summed (Lall, Marsden and Glavaski 2002, Int. J. Robust Nonlinear Control 12). There is no process noise in it.
    """
    own = found.experiment
    base, columns = own.start(), []
    for k, name in enumerate(own.names):
        size = share * own.priors.get(name, abs(base[k]) or 1.0)
        ends = []
        for sign in (1, -1):
            moved = base.copy()
            moved[k] += sign * size
            ends.append(_simulated(own, moved))
        columns.append((ends[0] - ends[1]) / (2 * size))
    slopes = np.stack(columns, axis=1)
    return slopes.T @ slopes


def _simulated(own: Experiment, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """All measurements in their standard deviations."""
    found = []
    for k, time in enumerate(own.times):
        if k:
            z = own.step(z, float(own.times[k - 1]), float(time))[0]
        outputs, _ = own.sensed(z, float(time))
        found += [
            outputs[index] / own.noise[name]
            for index, name in enumerate(own.model.outputs)
            if name in own.noise and k % own.every.get(name, 1) == 0
        ]
    return np.array(found)


def _triangle(stacked: Float[np.ndarray, "k n"], size: int) -> Float[np.ndarray, "n n"]:
    upper = np.asarray(qr(stacked, mode="r", check_finite=False)[0])[:size]
    return np.vstack([upper, np.zeros((size - len(upper), upper.shape[1]))])


def _covariance(root: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """(R' R)^-1, infinite in what the null directions of R move."""
    scale, sizes, axes, null = _scaled_singular_values(root)
    regular = (axes[~null] / sizes[~null, np.newaxis]).T / scale[:, np.newaxis]
    covariance = regular @ regular.T
    lost = (np.abs(axes[null]) > 1e-6).any(axis=0)
    covariance[lost, lost] = np.inf
    return covariance


def _null_shares(root: Float[np.ndarray, "n n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Right singular vectors, with share 1 where there is no information."""
    scale, _, axes, null = _scaled_singular_values(root)
    return null.astype(float), axes.T / scale[:, np.newaxis]


def _scaled_singular_values(
    root: Float[np.ndarray, "n n"],
) -> tuple[
    Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, "n n"], Bool[np.ndarray, " n"]
]:
    """Lengths of a root's columns; singular values of the root over them, right singular vectors, and which values are zero."""
    scale = np.linalg.norm(root, axis=0)
    scale[scale == 0] = 1.0
    _, sizes, axes = np.linalg.svd(root / scale)
    return scale, sizes, axes, sizes <= SINGULAR * max(sizes[0], 1e-300)


def _growth(
    narrow: Float[np.ndarray, "n n"], wide: Float[np.ndarray, "n n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Shares of the priors that remain, and directions: eigenvectors of the wide covariance relative to the narrow one.

    The share of what a variance grows by is `observability.cramer_rao.prior_share`.
    """
    covariance = _covariance(narrow)
    other = _covariance(wide)
    if not (np.isfinite(covariance).all() and np.isfinite(other).all()):
        return _null_shares(narrow)
    lower = np.linalg.cholesky(covariance)
    middle = np.linalg.solve(lower, np.linalg.solve(lower, other).T)
    growths, axes = np.linalg.eigh((middle + middle.T) / 2)
    return prior_share(growths.clip(1.0)), lower @ axes
