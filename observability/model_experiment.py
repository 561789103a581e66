"""One flight of a user's system: true values, noise, priors, known inputs; and its linearisation along the trajectory."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from observability.model import Model
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import refuse
from spinfilters.io.input_file import reason

FEWEST_STEPS: Final = 4
"""Runge-Kutta steps between two times."""
MOST_STEPS: Final = 5000
STEP_SIZE: Final = 0.5
"""Of a Runge-Kutta step, over the largest eigenvalue of the motion."""

Course = Callable[[float], float] | Sequence[float] | Float[np.ndarray, " t"] | float
"""A known input: a function of time, its values at the times (linear in between), or a constant."""


@dataclass(frozen=True)
class LinearisedCourse:
    """A true trajectory and how everything moves along it.

    Attributes
    ----------
    values : ndarray of shape (t, n)
        Unknowns at the times.
    transitions : ndarray of shape (t - 1, n, n)
        Derivatives of the unknowns at the next time by those here.
    entries : sequence of ndarrays of shape (n, q)
        By which process noise of unit variance enters on the way, q independent ones.
    slopes : ndarray of shape (t, o, n)
        Derivatives of the outputs by the unknowns of their time.
    """

    values: Float[np.ndarray, "t n"]
    transitions: Float[np.ndarray, "s n n"]
    entries: Sequence[Float[np.ndarray, "n q"]]
    slopes: Float[np.ndarray, "t o n"]


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
        Of the measurements, s; the first is the time of the initial state. In discrete time one step lies between two.
    noise : Mapping[str, float]
        Standard deviation of each output that is measured.
    priors : Mapping[str, float]
        Standard deviations of states at the first time, parameters and unknown inputs; without one nothing is known.
    process_noise : Mapping[str, float]
        Power spectral density (unit^2/s) of the noise in the rate of a state or unknown input; in discrete time its variance.
    inputs : Mapping[str, Course]
        Known inputs.
    every : Mapping[str, int]
        An output measured at every so many times only.
    trajectory : Mapping[str, Course]
        Recorded states, which take the place of the simulated ones at every time.
    after : Experiment, optional
        An earlier flight with the same parameters, which are known from it; their priors are then those of the earlier one.
    """

    model: Model
    values: Mapping[str, float]
    times: Float[np.ndarray, " t"]
    noise: Mapping[str, float]
    priors: Mapping[str, float] = field(default_factory=dict)
    process_noise: Mapping[str, float] = field(default_factory=dict)
    inputs: Mapping[str, Course] = field(default_factory=dict)
    every: Mapping[str, int] = field(default_factory=dict)
    trajectory: Mapping[str, Course] = field(default_factory=dict)
    after: "Experiment | None" = None

    def __post_init__(self) -> None:
        model = self.model
        needed = [*model.states, *model.parameters, *model.known_constants, *model.unknown_inputs]
        lacking = [
            name for name in needed if name not in self.trajectory and name not in model.known_initial_values
        ]
        for what, given, allowed, required in (
            ("values", self.values, needed, lacking),
            ("inputs", self.inputs, [*model.inputs], [*model.inputs]),
            ("noise", self.noise, [*model.outputs], []),
            ("priors", self.priors, [*self.names], []),
            ("process_noise", self.process_noise, [*model.states, *model.unknown_inputs], []),
            ("every", self.every, [*model.outputs], []),
            ("trajectory", self.trajectory, [*model.states], []),
        ):
            foreign = [name for name in given if name not in allowed]
            if foreign:
                raise InputError(
                    f"{model.name}: {what} names {foreign[0]!r}, which is not there; use {', '.join(allowed) or 'none'}"
                )
            missing = [name for name in required if name not in given]
            if missing:
                raise InputError(f"{model.name}: {what} has no {missing[0]!r}; give it a number")
        broken = [name for name, each in self.every.items() if each != int(each)]
        if broken:
            raise InputError(
                f"{model.name}: every of {broken[0]} is {self.every[broken[0]]}; give a whole number from 1"
            )
        for what, numbers in (("noise", self.noise), ("priors", self.priors), ("every", self.every)):
            wrong = [name for name, each in numbers.items() if not 0 < each < np.inf]
            if wrong:
                raise InputError(
                    f"{model.name}: {what} of {wrong[0]} is {numbers[wrong[0]]}; give a positive number"
                )
        wrong = [name for name, each in self.process_noise.items() if not 0 <= each < np.inf]
        if wrong:
            raise InputError(
                f"{model.name}: process_noise of {wrong[0]} is {self.process_noise[wrong[0]]}; give 0 or more"
            )
        increasing = self.times.ndim == 1 and len(self.times) > 1 and np.isfinite(self.times).all()
        if not increasing or not (np.diff(self.times) > 0).all():
            raise InputError(
                f"{model.name}: times have to increase, and be at least two; give them in s, as a list or an array"
            )
        for what, courses in (("inputs", self.inputs), ("trajectory", self.trajectory)):
            for name, course in courses.items():
                self._require_course(f"{what} of {name}", course)
        if self.after is not None and self.after.model.parameters != model.parameters:
            raise InputError(f"{model.name}: the earlier experiment has other parameters; give both the same")

    def _require_course(self, where: str, course: Any) -> None:
        """InputError: neither a function, nor a number, nor a finite number for each time."""
        if callable(course):
            return
        try:
            values = np.asarray(course, dtype=float)
        except (TypeError, ValueError):
            refuse(
                f"{self.model.name}: {where}",
                course,
                "a function of time, a number, or a number for each time",
            )
        if values.ndim and values.shape != self.times.shape:
            raise InputError(
                f"{self.model.name}: {where} has {values.size} values for {len(self.times)} times; give one for each time"
            )
        if not np.isfinite(values).all():
            raise InputError(f"{self.model.name}: {where} has values that are not finite; give finite ones")

    @property
    def names(self) -> tuple[str, ...]:
        """States, unknown inputs, parameters: the order of all arrays."""
        return (*self.model.states, *self.model.unknown_inputs, *self.model.parameters)

    @cached_property
    def constants(self) -> Float[np.ndarray, " c"]:
        """Values of the known constants."""
        return np.array([float(self.values[name]) for name in self.model.known_constants])

    @cached_property
    def course(self) -> LinearisedCourse:
        """The linearisation along the whole trajectory.

        Raises
        ------
        InputError
            Where the trajectory leaves the numbers.
        """
        z, values, transitions, entries, slopes = self.start(), [], [], [], []
        for k, time in enumerate(self.times.tolist()):
            if k:
                z, transition, noise = self.step(z, float(self.times[k - 1]), time)
                if np.isfinite(noise).all() and np.isfinite(transition).all():
                    sizes, axes = np.linalg.eigh(noise)
                    kept = sizes > 1e-14 * max(sizes[-1], 0.0)
                    entries.append(axes[:, kept] * np.sqrt(sizes[kept]))
                    transitions.append(transition)
            z = self._recorded(z, time)
            values.append(z)
            slopes.append(self.sensed(z, time)[1])
            if len(transitions) < k or not (np.isfinite(z).all() and np.isfinite(slopes[-1]).all()):
                raise InputError(
                    f"{self.model.name}: the trajectory leaves the numbers at t = {time:g} s; check values and times"
                )
        return LinearisedCourse(np.stack(values), np.stack(transitions), entries, np.stack(slopes))

    @cached_property
    def advance(self) -> Compiled:
        """One Runge-Kutta step: (z, Phi, P, inputs at its begin, middle and end, constants, width) -> (z, Phi, P)."""
        z, u, c = self._symbols
        size, rates = z.numel(), self._rates
        slope = ca.jacobian(rates, z)
        phi, cov = ca.SX.sym("phi", size, size), ca.SX.sym("cov", size, size)
        grown = slope @ cov
        out = [rates, slope @ phi, grown + grown.T + ca.DM(self.density)]
        return _runge_kutta(ca.Function("flow", [z, phi, cov, u, c], out), 3)

    @cached_property
    def moved(self) -> Compiled:
        """The same of z alone: (z, inputs at the begin, middle and end, constants, width) -> z."""
        z, u, c = self._symbols
        return _runge_kutta(ca.Function("motion", [z, u, c], [self._rates]), 1)

    @cached_property
    def rates(self) -> Compiled:
        """(z, u, constants) -> rates (in discrete time the next values) and their Jacobian."""
        z, u, c = self._symbols
        rates = self._rates
        return Compiled.interpreted(ca.Function("rates", [z, u, c], [rates, ca.jacobian(rates, z)]))

    @cached_property
    def sensing(self) -> Compiled:
        """(z, u, constants) -> outputs and their Jacobian."""
        z, u, c = self._symbols
        outputs = ca.vertcat(*self.model.outputs.values())
        return Compiled.interpreted(ca.Function("sensing", [z, u, c], [outputs, ca.jacobian(outputs, z)]))

    @property
    def density(self) -> Float[np.ndarray, "n n"]:
        """Process noise of all unknowns."""
        return np.diag([float(self.process_noise.get(name, 0.0)) for name in self.names])

    @property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        symbols = self.model.symbols
        groups = (self.names, self.model.inputs, self.model.known_constants)
        z, u, c = (ca.vertcat(ca.SX(0, 1), *[symbols[name] for name in group]) for group in groups)
        return z, u, c

    @property
    def _rates(self) -> ca.SX:
        constant = self.names[len(self.model.states) :]
        still = [self.model.symbols[name] if self.model.discrete else ca.SX(0) for name in constant]
        return ca.vertcat(*self.model.rates.values(), *still)

    def start(self) -> Float[np.ndarray, " n"]:
        """True unknowns at the first time."""
        known = self.model.known_initial_values
        z = np.array([float(self.values.get(name, 0.0)) for name in self.names])
        if known:
            z[[self.names.index(name) for name in known]] = self.known_start(z, self.constants)[0]
        return self._recorded(z, float(self.times[0]))

    @cached_property
    def known_start(self) -> Compiled:
        """(z, constants) -> known initial values and their Jacobian."""
        z, _, c = self._symbols
        values = ca.vertcat(*self.model.known_initial_values.values())
        return Compiled.interpreted(ca.Function("known_start", [z, c], [values, ca.jacobian(values, z)]))

    @property
    def free(self) -> list[int]:
        """Indices of the unknowns without a known initial value."""
        return [k for k, name in enumerate(self.names) if name not in self.model.known_initial_values]

    def start_slopes(self) -> Float[np.ndarray, "n n"]:
        """Of all unknowns at the first time by the free ones of them."""
        z, slopes = self.start(), np.eye(len(self.names))
        for name, row in zip(
            self.model.known_initial_values, self.known_start(z, self.constants)[1], strict=True
        ):
            slopes[self.names.index(name)] = row
        return slopes

    def input_values(self, time: float) -> Float[np.ndarray, " u"]:
        """Known inputs at a time."""
        return np.array([self._value(name, self.inputs[name], time) for name in self.model.inputs])

    def _value(self, name: str, course: Course, time: float) -> float:
        if callable(course):
            return _number_of(course, time, f"{self.model.name}: the course of {name}")
        values = np.broadcast_to(np.asarray(course, dtype=float), self.times.shape)
        return float(np.interp(time, self.times, values))

    def _recorded(self, z: Float[np.ndarray, " n"], time: float) -> Float[np.ndarray, " n"]:
        """The same with what was recorded."""
        if not self.trajectory:
            return z
        z = z.copy()
        for name, course in self.trajectory.items():
            z[self.names.index(name)] = self._value(name, course, time)
        return z

    def step(
        self, z: Float[np.ndarray, "*b n"], first: float, last: float
    ) -> tuple[Float[np.ndarray, "*b n"], Float[np.ndarray, "*b n n"], Float[np.ndarray, "*b n n"]]:
        """z at the next time, the transition to it, and the covariance of the process noise in between; of several at once, too."""
        if self.model.discrete:
            following, transition = self.rates(z, self.input_values(first), self.constants)
            return following, transition, self.density
        transition, noise = np.eye(z.shape[-1]), np.zeros((z.shape[-1], z.shape[-1]))
        for given in self._given(z, first, last):
            z, transition, noise = self.advance(z, transition, noise, *given)
        return z, transition, noise

    def following(self, z: Float[np.ndarray, "*b n"], first: float, last: float) -> Float[np.ndarray, "*b n"]:
        """z at the next time, of one start or of several at once, in the same steps."""
        if self.model.discrete:
            return self.rates(z, self.input_values(first), self.constants)[0]
        for given in self._given(z, first, last):
            (z,) = self.moved(z, *given)
        return z

    def _given(
        self, z: Float[np.ndarray, "*b n"], first: float, last: float
    ) -> Iterator[tuple[np.ndarray, ...]]:
        """Inputs at the begin, middle and end of every Runge-Kutta step, constants, its width."""
        count = self._steps(z, first, last)
        inputs = [self.input_values(time) for time in np.linspace(first, last, 2 * count + 1).tolist()]
        width = np.array([(last - first) / count])
        for k in range(count):
            yield (*inputs[2 * k : 2 * k + 3], self.constants, width)

    def _steps(self, z: Float[np.ndarray, "*b n"], first: float, last: float) -> int:
        """Runge-Kutta steps, from the fastest mode of the states."""
        _, slope = self.rates(z, self.input_values(first), self.constants)
        moving = slope[..., : len(self.model.states), : len(self.model.states)]
        if not np.isfinite(moving).all():
            return FEWEST_STEPS
        fastest = float(np.abs(np.linalg.eigvals(moving)).max(initial=0.0))
        count = max(FEWEST_STEPS, int(np.ceil((last - first) * fastest / STEP_SIZE)))
        if count > MOST_STEPS:
            raise InputError(
                f"{self.model.name}: a mode of {fastest:.3g} 1/s needs {count} steps between two times at t = {first:g} s; "
                "give closer times, or leave out the fast mode"
            )
        return count

    def sensed(
        self, z: Float[np.ndarray, " n"], time: float
    ) -> tuple[Float[np.ndarray, " o"], Float[np.ndarray, "o n"]]:
        """Outputs and their Jacobian."""
        values, slopes = self.sensing(z, self.input_values(time), self.constants)
        return values, slopes

    def measured(self, k: int) -> list[tuple[int, float]]:
        """Indices of the outputs that are measured at a time, with their standard deviations."""
        return [
            (index, self.noise[name])
            for index, name in enumerate(self.model.outputs)
            if name in self.noise and k % self.every.get(name, 1) == 0
        ]

    def simulated(self, z: Float[np.ndarray, "b n"]) -> Float[np.ndarray, "b m"]:
        """All measurements from unknowns at the first time, each in its standard deviation, for several at once."""
        found, known = [], [self.names.index(name) for name in self.model.known_initial_values]
        if known:
            z = z.copy()
            z[:, known] = self.known_start(z, self.constants)[0]
        for k, time in enumerate(self.times.tolist()):
            if k:
                z = self.following(z, float(self.times[k - 1]), time)
            outputs, _ = self.sensing(z, self.input_values(time), self.constants)
            found += [outputs[:, index] / deviation for index, deviation in self.measured(k)]
        return np.stack(found, axis=1)

    def outputs_between(self, intervals: int, parts: int) -> Float[np.ndarray, "m o"]:
        """Outputs of the trajectory in the first intervals, at so many times an interval."""
        found, z = [], self.start()
        for first, last in pairwise(self.times[: intervals + 1].tolist()):
            z = self._recorded(z, first)
            for now, end in pairwise(np.linspace(first, last, parts + 1).tolist()):
                found.append(self.sensed(z, now)[0])
                z = self.following(z, now, end)
        return np.array(found)


def _number_of(course: Callable[[float], float], time: float, where: str) -> float:
    """A function's value at a time.

    Raises
    ------
    InputError
        Where it stops, or returns no finite number.
    """
    try:
        value = float(course(time))
    except Exception as error:
        raise InputError(
            f"{where} stops at t = {time:g} with {type(error).__name__}: {reason(error)}; let it return a number at all times"
        ) from None
    if not np.isfinite(value):
        raise InputError(f"{where} is {value:g} at t = {time:g}; change it so that it is finite at all times")
    return value


def _runge_kutta(flow: ca.Function, moving: int) -> Compiled:
    """One step of the fourth order for a flow of its first arguments, then inputs and constants."""
    state = [ca.SX.sym(f"z{k}", *flow.size_in(k)) for k in range(moving)]
    inputs = [ca.SX.sym(f"u{k}", *flow.size_in(moving)) for k in range(3)]
    constants, width = ca.SX.sym("c", *flow.size_in(moving + 1)), ca.SX.sym("h")
    slopes: list[list[ca.SX]] = []
    for shift, u in ((0.0, inputs[0]), (0.5, inputs[1]), (0.5, inputs[1]), (1.0, inputs[2])):
        at = [z + shift * width * k for z, k in zip(state, slopes[-1], strict=True)] if slopes else state
        found = flow(*at, u, constants)
        slopes.append(list(found) if moving > 1 else [found])
    ends = [z + width / 6 * (a + 2 * b + 2 * c + d) for z, a, b, c, d in zip(state, *slopes, strict=True)]
    return Compiled.interpreted(ca.Function("advance", [*state, *inputs, constants, width], ends))
