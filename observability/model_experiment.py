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
from observability.stepped_motion import MOST_STEPS, SteppedIntervals, SteppedMotion
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError
from spinfilters.io.argument_checks import refuse
from spinfilters.io.input_file import reason

FEWEST_STEPS: Final = 4
"""Runge-Kutta steps between two times."""
STEP_SIZE: Final = 0.5
"""Of a Runge-Kutta step, over the largest eigenvalue of the motion."""

Course = Callable[[float], float] | Sequence[float] | Float[np.ndarray, " t"] | float
"""A known input: a function of time, its values at the times (linear in between), or a constant."""

Progress = Callable[[str, int, int], None]
"""Takes the name of the work, what is done and all of it."""


def no_progress(_name: str, _done: int, _total: int) -> None:
    """Show nothing."""


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
    progress : Callable[[str, int, int], None]
        Called with the name of the work, the times done and all of them.
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
    progress: Progress = no_progress

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
        recorded = {self.names.index(name): self.input_table(name, self.times) for name in self.trajectory}
        values, transitions, entries = [self.start()[np.newaxis]], [], []
        for block in self._blocks(self.start(), recorded):
            passed = self.times[block.first + 1 : block.first + 1 + len(block.ends)]
            ends = block.ends.copy()
            for index, column in recorded.items():
                ends[:, index] = column[block.first + 1 : block.first + 1 + len(ends)]
            transition, noise = self._motion(*recorded).transitions(block)
            reached = np.concatenate(
                [each.reshape(len(ends), -1) for each in (ends, transition, noise)], axis=1
            )
            self._require_finite(reached, passed)
            values.append(ends)
            transitions.append(transition)
            entries += _entries(noise)
            self.progress("trajectory", block.first + 1 + len(ends), len(self.times))
        whole = np.concatenate(values)
        slopes = self.sensed_at(whole, self.times)[1]
        self._require_finite(slopes.reshape(len(whole), -1), self.times)
        return LinearisedCourse(whole, np.concatenate(transitions), entries, slopes)

    def _require_finite(self, reached: Float[np.ndarray, "t k"], times: Float[np.ndarray, " t"]) -> None:
        """InputError: what is reached at the times is not finite at all of them."""
        if not np.isfinite(reached).all():
            time = float(times[np.nonzero(~np.isfinite(reached))[0][0]])
            raise InputError(
                f"{self.model.name}: the trajectory leaves the numbers at t = {time:g} s; check values and times"
            )

    def _motion(self, *recorded: int) -> SteppedMotion:
        """One step; it is given inputs at its begin, middle and end, width, whether an interval begins, what was recorded."""
        if recorded not in self._motions:
            self._motions[recorded] = self._new_motion(recorded)
        return self._motions[recorded]

    @cached_property
    def _motions(self) -> dict[tuple[int, ...], SteppedMotion]:
        """By what was recorded."""
        return {}

    def _new_motion(self, recorded: tuple[int, ...]) -> SteppedMotion:
        size, count, states = len(self.names), len(self.model.inputs), len(self.model.states)
        z, inputs, width = ca.SX.sym("z", size), ca.SX.sym("u", count, 3), ca.SX.sym("h")
        flag, taken = ca.SX.sym("flag"), ca.SX.sym("taken", len(recorded))
        given = ca.vertcat(ca.vec(inputs), width, flag, taken)
        begin = ca.SX(z)
        for k, index in enumerate(recorded):
            begin[index] = ca.if_else(flag, taken[k], z[index])
        u, constants = [inputs[:, k] for k in range(3)], ca.DM(self.constants)
        _, slope = self.rates.function(z, u[0], constants)
        if self.model.discrete:
            end = self.rates.function(begin, u[0], constants)[0]
            spread = [slope, ca.SX(ca.DM(self.density))]
        else:
            end = self.moved.function(begin, *u, constants, width)
            nothing = ca.DM.zeros(size, size)
            spread = self.advance.function(z, ca.DM.eye(size), nothing, *u, constants, width)[1:]
        return SteppedMotion(
            ca.Function("step", [z, given], [end]),
            ca.Function("slopes", [z, given], list(spread)),
            ca.Function("modes", [z, given], [ca.SX(slope)[:states, :states]]),
        )

    def _blocks(
        self, z: Float[np.ndarray, " n"], recorded: Mapping[int, Float[np.ndarray, " t"]]
    ) -> Iterator[SteppedIntervals]:
        """The motion from a start, some intervals at a time."""
        motion, times, widths = self._motion(*recorded), self.times, np.diff(self.times)
        columns = np.stack([*recorded.values()], axis=1) if recorded else np.zeros((len(times), 0))

        def given(first: int, number: int, steps: int) -> Float[np.ndarray, "i s p"]:
            """Inputs, widths and records of the steps."""
            self._require_few(steps, steps * STEP_SIZE / widths[first], times[first])
            parts = 2 * steps
            shares = np.arange(parts + 1) / parts
            at = times[first : first + number, np.newaxis] + np.multiply.outer(
                widths[first : first + number], shares
            )
            if self.model.discrete:
                at[:] = times[first : first + number, np.newaxis]
            at[:, -1] = at[:, -1] if self.model.discrete else times[first + 1 : first + 1 + number]
            inputs = np.stack([self.input_table(name, at) for name in self.model.inputs] or [at])
            inputs = np.moveaxis(inputs, 0, -1)[..., : len(self.model.inputs)]
            flag = np.zeros((number, steps, 1))
            flag[:, 0] = 1.0
            width = np.broadcast_to(
                widths[first : first + number, np.newaxis, np.newaxis] / steps, flag.shape
            )
            taken = np.repeat(columns[first : first + number, np.newaxis], steps, axis=1)
            return np.concatenate(
                [inputs[:, :-2:2], inputs[:, 1:-1:2], inputs[:, 2::2], width, flag, taken], axis=2
            )

        def steps_needed(first: int, z: Float[np.ndarray, "i n"]) -> np.ndarray:
            """From the fastest mode of the states."""
            if self.model.discrete:
                return np.ones(len(z), dtype=int)
            number = len(z)
            fastest = motion.fastest(z, given(first, number, 1)[:, 0])
            counts = np.ceil(widths[first : first + number] * fastest / STEP_SIZE)
            return np.maximum(FEWEST_STEPS, np.minimum(counts, 1e9)).astype(int)

        def with_records(first: int, z: Float[np.ndarray, "i n"]) -> Float[np.ndarray, "i n"]:
            """What was recorded takes the place of what was simulated."""
            z = z.copy()
            z[:, list(recorded)] = columns[first : first + len(z)]
            return z

        return motion.blocks(z, len(times) - 1, steps_needed, given, with_records)

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

    def input_table(self, name: str, times: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
        """A known input or recorded state at several times."""
        course = self.inputs[name] if name in self.inputs else self.trajectory[name]
        if not callable(course):
            values = np.broadcast_to(np.asarray(course, dtype=float), self.times.shape)
            return np.interp(times, self.times, values)
        at_times = getattr(course, "at_times", None)
        if at_times is None:
            found = [self._value(name, course, time) for time in times.ravel().tolist()]
            return np.array(found).reshape(times.shape)
        values = np.asarray(at_times(times.ravel())).reshape(times.shape)
        if not np.isfinite(values).all():
            self._value(name, course, float(times[~np.isfinite(values)].min()))
        return values

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
            return following, transition.reshape(*z.shape, z.shape[-1]), self.density
        square = (*z.shape, z.shape[-1])
        transition, noise = np.broadcast_to(np.eye(z.shape[-1]), square), np.zeros(square)
        for given in self._step_inputs(z, first, last):
            if z.shape[-1] == 1:
                transition, noise = transition[..., 0], noise[..., 0]
            z, transition, noise = (part for part in self.advance(z, transition, noise, *given))
            transition, noise = transition.reshape(square), noise.reshape(square)
        return z, transition, noise

    def following(self, z: Float[np.ndarray, "*b n"], first: float, last: float) -> Float[np.ndarray, "*b n"]:
        """z at the next time, of one start or of several at once, in the same steps."""
        if self.model.discrete:
            return self.rates(z, self.input_values(first), self.constants)[0]
        for given in self._step_inputs(z, first, last):
            (z,) = self.moved(z, *given)
        return z

    def _step_inputs(
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
        moving = slope.reshape(*z.shape, z.shape[-1])[..., : len(self.model.states), : len(self.model.states)]
        if not np.isfinite(moving).all():
            return FEWEST_STEPS
        fastest = float(np.abs(np.linalg.eigvals(moving)).max(initial=0.0))
        count = max(FEWEST_STEPS, int(np.ceil((last - first) * fastest / STEP_SIZE)))
        self._require_few(count, fastest, first)
        return count

    def _require_few(self, steps: int, fastest: float, time: float) -> None:
        """InputError: a mode so fast (1/s) that an interval from a time needs too many steps."""
        if steps > MOST_STEPS:
            raise InputError(
                f"{self.model.name}: a mode of {fastest:.3g} 1/s needs {steps} steps between two times at t = {time:g} s; "
                "give closer times, or leave out the fast mode"
            )

    def sensed_at(
        self, z: Float[np.ndarray, "*b n"], times: Float[np.ndarray, "*b"]
    ) -> tuple[Float[np.ndarray, "*b o"], Float[np.ndarray, "*b o n"]]:
        """Outputs and their Jacobians at several times."""
        inputs = np.stack([self.input_table(name, times) for name in self.model.inputs] or [times], axis=-1)
        values, slopes = self.sensing(z, inputs[..., : len(self.model.inputs)], self.constants)
        return values, slopes.reshape(*values.shape, z.shape[-1])

    def measured(self, k: int) -> list[tuple[int, float]]:
        """Indices of the outputs that are measured at a time, with their standard deviations."""
        return [
            (index, self.noise[name])
            for index, name in enumerate(self.model.outputs)
            if name in self.noise and k % self.every.get(name, 1) == 0
        ]

    def simulated(self, z: Float[np.ndarray, "b n"]) -> Float[np.ndarray, "b m"]:
        """All measurements from unknowns at the first time, each in its standard deviation, for several at once.

        Every row of ``z`` is integrated with the Runge-Kutta steps that the first row needs.
        """
        known = [self.names.index(name) for name in self.model.known_initial_values]
        if known:
            z = z.copy()
            z[:, known] = self.known_start(z, self.constants)[0]
        blocks = [block.given for block in self._blocks(z[0], {})]
        ends = [z[np.newaxis], *self._motion().run_several(z, blocks)]
        passed = np.concatenate(ends)
        outputs, _ = self.sensed_at(passed, np.repeat(self.times[:, np.newaxis], len(z), axis=1))
        return np.stack(
            [
                outputs[k, :, index] / deviation
                for k in range(len(self.times))
                for index, deviation in self.measured(k)
            ],
            axis=1,
        )

    def outputs_between(self, intervals: int, parts: int) -> Float[np.ndarray, "m o"]:
        """Outputs of the trajectory in the first intervals, at so many times an interval."""
        states, times, z = [], [], self.start()
        for first, last in pairwise(self.times[: intervals + 1].tolist()):
            z = self._recorded(z, first)
            for now, end in pairwise(np.linspace(first, last, parts + 1).tolist()):
                states.append(z)
                times.append(now)
                z = self.following(z, now, end)
        return self.sensed_at(np.array(states), np.array(times))[0]


def _entries(noise: Float[np.ndarray, "i n n"]) -> list[Float[np.ndarray, "n q"]]:
    """Of covariances, by which independent noises of unit variance enter."""
    if not noise.any():
        return [np.zeros((noise.shape[-1], 0))] * len(noise)
    sizes, axes = np.linalg.eigh(noise)
    kept = sizes > 1e-14 * np.maximum(sizes[:, -1:], 0.0)
    return [axis[:, some] * np.sqrt(size[some]) for axis, some, size in zip(axes, kept, sizes, strict=True)]


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
