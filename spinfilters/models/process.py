"""Process model of a rigid body that turns and moves freely: propagation, linearised steps, process noise.

Disturbances are white, with the densities of `ProcessNoise`. Drag, a constant torque, a flywheel and a constant acceleration are
optional blocks of the state (`spinfilters.models.state_blocks`).

To add to the model:

- a torque is a term of `body_acceleration`, of rate, inertia and constants. Its constant is a state block, named in
  `ACCELERATION_TERMS` of `spinfilters.models.rotation_integrator`, which `derivative` and all integrators read. No torque is given
  the time, the attitude or a field (docs/how-to/add-a-force-or-torque.md says what these need);
- a force is a term of `RotationSubsteps.translated` in that file, which moves the centre of mass in filters, smoother and
  simulation. Repeat it in `derivative`, else verdict and observability analyser miss it;
- a white disturbance is an entry of `spinfilters.io.disturbances.DISTURBANCES`, and its part of the noise factor G in
  `RotationSubsteps.assemble` of that file;
- a block that drifts, such as a Markov bias, decays in `RotationSubsteps.translated` and in `derivative`. Its drive is a white
  disturbance.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, make_dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_expressions import Expression, quaternion_rate, rotate
from spinfilters.core.compiled import Compiled
from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import inertia
from spinfilters.core.vectorised import VectorisedScan
from spinfilters.core.working_time import building, built_property
from spinfilters.io.disturbances import DENSITIES, DISTURBANCES, noise_columns
from spinfilters.models.batched_linearisation import BatchedLinearisation, StepsScan
from spinfilters.models.rotation_integrator import (
    MAX_SUBSTEPS,
    LinearisedLoops,
    LinearisedScan,
    LinearisedStep,
    LinearisedSteps,
    RotationIntegrator,
    StepLoops,
    acceleration_constants,
    rotation_difference,
    rotation_parameters,
    substep_numbers,
    substeps,
    turns,
)
from spinfilters.models.state_blocks import ACCELERATION, ATTITUDE
from spinfilters.models.state_layout import StateLayout

SMALLEST_SQUARE = 1e-300
"""Added under a square root, so that the drag of a body at rest has a derivative."""
MOST_SUBSTEPS, USUAL_SUBSTEPS = 1 << 17, 64
"""Largest number of substeps of a whole motion, or of each step on average. The first takes 0.2 s of processor time, and an
initialisation integrates a motion up to a hundred times."""


if TYPE_CHECKING:

    @dataclass(frozen=True)
    class _NoiseDensities:
        force_psd: float = 4e-8
        torque_psd: float = 1e-6

else:
    _NoiseDensities = make_dataclass(
        "_NoiseDensities",
        [(each.option, float, field(default=each.mild)) for each in DISTURBANCES],
        frozen=True,
        namespace={"__module__": __name__},
    )


@dataclass(frozen=True)
class ProcessNoise(_NoiseDensities):
    """Densities of the white disturbances; each at least 0.

    Every one of `spinfilters.io.disturbances.DENSITIES` is a field: ``force_psd`` of the acceleration of the centre of mass,
    (m/s^2)^2/Hz, and ``torque_psd`` of the angular acceleration, (rad/s^2)^2/Hz.
    """

    def __post_init__(self) -> None:
        for name, value in self.densities.items():
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"{name} is {value}; give a finite density of at least 0")

    @property
    def densities(self) -> dict[str, float]:
        """Every density by its key."""
        return {name: getattr(self, name) for name in DENSITIES}


THESIS_NOISE = ProcessNoise(**{name: each.default for name, each in DENSITIES.items()})
"""Disturbances of the thesis' experiment (Tweddle 2013, Eqs 6.14 and 6.15, which are roots of densities: 0.001 (m/s^2)/sqrt(Hz),
0.001 (rad/s^2)/sqrt(Hz))."""


def body_acceleration(
    w: Expression,
    J: Expression,
    drag: Expression | None = None,
    torque: Expression | None = None,
    rotor: Expression | None = None,
    linear_drag: Expression | None = None,
) -> Expression:
    """Body acceleration w' in g axes, rad/s^2 (Tweddle 2013, Eq. 4.103).

    w' = J^-1 ((J w + h) x w) - d |w| w - l w + m. Eq. 4.103 as printed lacks the minus sign of Eqs 3.16 to 3.18.

    Parameters
    ----------
    w : Expression
        Body rate, rad/s.
    J : Expression
        Inertia up to scale, 3 x 3.
    drag : Expression | None
        d, 1/rad.
    torque : Expression | None
        m, the angular acceleration of a constant body torque, rad/s^2.
    rotor : Expression | None
        h, the constant angular momentum of a flywheel inside, in units of J times rad/s.
    linear_drag : Expression | None
        l, 1/s.
    """
    momentum = J @ w if rotor is None else J @ w + rotor
    acceleration = ca.inv_minor(J) @ ca.cross(momentum, w)
    if drag is not None:
        acceleration = acceleration - drag * ca.sqrt(ca.dot(w, w) + SMALLEST_SQUARE) * w
    if linear_drag is not None:
        acceleration = acceleration - linear_drag * w
    return acceleration if torque is None else acceleration + torque


def derivative(layout: StateLayout, x: Expression) -> Expression:
    """The continuous model without noise: x', laid out as a point is (the attitude's part is the rate q' of the quaternion).

    The verdict and the observability analyser differentiate it. Filters, smoother and simulation do not: they integrate
    `body_acceleration` and move the centre of mass by `RotationSubsteps.translated`.

    Parameters
    ----------
    layout : StateLayout
        Blocks of the state.
    x : Expression
        Point, (mean_dim,).

    Returns
    -------
    Expression
        Time derivative, (mean_dim,).
    """
    values = layout.unpack(x)
    rates = {name: 0 * value for name, value in values.items()}
    rates["q"] = quaternion_rate(values["q"], values["w"])
    rates["w"] = body_acceleration(values["w"], inertia(values["s"]), **acceleration_constants(values))
    if layout.has(ACCELERATION):
        rates["v"] = values["f"]
    if layout.translates:
        rates["t"] = values["v"] - rotate(values["q"], ca.cross(values["w"], values["c"]))
    return layout.pack(rates)


_PathSteps = Callable[[np.ndarray, float, np.ndarray, int], tuple[np.ndarray, np.ndarray]]
"""Parts of many paths from points, the duration of a step, impulses and substeps, with the largest error of a step of each."""
INTERVALS_PER_CALL = 64
"""Intervals of a path in one compiled call; the last call is padded with undisturbed steps, which are cut off."""


class TorqueFreeProcess:
    """Discrete process model over any layout with the blocks a, w and s.

    The blocks t, v and c (together) and all other constants are optional. Without the blocks of drag and torque the body is
    free of torques, but for white disturbances.

    Parameters
    ----------
    layout : StateLayout
        The state's blocks.
    noise : ProcessNoise
        Disturbance densities.
    tolerance : float
        Bound on the integration error of one step, rad and relative rate; the step is halved until it is met.
    """

    def __init__(self, layout: StateLayout, noise: ProcessNoise, tolerance: float = 1e-9) -> None:
        self.layout = layout
        self.noise = noise
        self._tolerance = tolerance
        self._integrator, self._many, self._disturbed = _integrators(layout, tolerance)

    def with_noise(self, noise: ProcessNoise) -> "TorqueFreeProcess":
        """The same body with other disturbances.

        Parameters
        ----------
        noise : ProcessNoise
            Densities of the disturbances.

        Returns
        -------
        TorqueFreeProcess
            Process of the same layout and tolerance.
        """
        return TorqueFreeProcess(self.layout, noise, self._tolerance)

    def with_layout(self, layout: StateLayout) -> "TorqueFreeProcess":
        """The same disturbances over another layout.

        Parameters
        ----------
        layout : StateLayout
            Blocks of its state.

        Returns
        -------
        TorqueFreeProcess
            Process with the same noise and tolerance.
        """
        return TorqueFreeProcess(layout, self.noise, self._tolerance)

    def step(self, x: Float[np.ndarray, "*batch m"], dt: float) -> Float[np.ndarray, "*batch m"]:
        """Points after ``dt`` seconds (dt > 0) without noise.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points of the layout.
        dt : float
            Duration, s; positive.

        Returns
        -------
        ndarray of float, shape (..., m)
            Points at the end.
        """
        return self._integrator.step(x, dt)

    def steps(self, x: Float[np.ndarray, "k m"], dt: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k m"]:
        """Points after ``dt`` seconds (dt > 0) of their own without noise.

        Parameters
        ----------
        x : ndarray of float, shape (k, m)
            Points of the layout.
        dt : ndarray of float, shape (k,)
            Duration of each, s; positive. Points of equal dt take as many substeps.

        Returns
        -------
        ndarray of float, shape (k, m)
            Points at the ends.
        """
        return self._integrator.steps(x, dt)

    def disturbed_steps(
        self, x: Float[np.ndarray, "*batch m"], dt: float, normal: Float[np.ndarray, "n *batch 2 b"]
    ) -> Float[np.ndarray, "*batch m"]:
        """Points after n disturbed steps of ``dt`` seconds (dt > 0).

        Half of a step's white disturbance acts before it, half after it.

        Parameters
        ----------
        x : ndarray of float, shape (..., m)
            Points before the first step.
        dt : float
            Duration of a step, s; positive.
        normal : Float[np.ndarray, 'n *batch 2 b']
            Independent standard normals before and after each step, in the columns of `impulse_columns`.

        Returns
        -------
        ndarray of float, shape (..., m)
            Points after the last step.
        """
        scale = np.sqrt(self._disturbed_densities * (dt / 2))
        return self._disturbed.run(x, dt, scale * normal)

    def disturbed_path(
        self, x: Float[np.ndarray, " m"], dt: float, normal: Float[np.ndarray, "n k 2 b"]
    ) -> Float[np.ndarray, "n_plus_1 m"]:
        """One disturbed motion at the ends of n intervals of ``dt`` seconds, the begin included, in k steps per interval.

        Parameters
        ----------
        x : ndarray of float, shape (m,)
            Point at the begin.
        dt : float
            Duration of an interval, s; positive.
        normal : Float[np.ndarray, 'n k 2 b']
            As of `disturbed_steps`, for every interval.

        Returns
        -------
        ndarray of float, shape (n + 1, m)
            Points at the begin and at the end of every interval.
        """
        h = dt / normal.shape[1]
        scale = np.sqrt(self._disturbed_densities * (h / 2))
        return self._disturbed.path(x, h, scale * normal)

    def disturbed_paths(
        self, x: Float[np.ndarray, "r m"], dt: float, normal: Float[np.ndarray, "r n k 2 b"]
    ) -> Float[np.ndarray, "r n_plus_1 m"]:
        """Many disturbed motions, each to the numbers of `disturbed_path` but for rounding, whatever motions are beside it.

        Parameters
        ----------
        x : ndarray of float, shape (r, m)
            Point of each at the begin.
        dt : float
            Duration of an interval, s; positive.
        normal : Float[np.ndarray, 'r n k 2 b']
            As of `disturbed_path`, for every motion.

        Returns
        -------
        ndarray of float, shape (r, n + 1, m)
            Points of each at the begin and at the end of every interval.
        """
        h = dt / normal.shape[2]
        scale = np.sqrt(self._disturbed_densities * (h / 2))
        return self._disturbed.paths(x, h, scale * normal)

    @property
    def impulse_columns(self) -> dict[str, slice]:
        """Components of a step's impulses, by disturbance: those of the body rate, then of the velocity if there is one."""
        return self._disturbed.impulse_columns

    @property
    def disturbed_dim(self) -> int:
        """Components of the impulses that white disturbances give in a step."""
        return self._disturbed.impulse_dim

    def linearise(self, x: Float[np.ndarray, " m"], dt: float) -> LinearisedStep:
        """Step of dt s with error transition and noise factor.

        Parameters
        ----------
        x : ndarray of float, shape (m,)
            Point before the step.
        dt : float
            Duration, s; positive.

        Returns
        -------
        LinearisedStep
            Point after it, error transition Phi (n, n), and factor G of the process noise, Q = G G'.
        """
        return self._integrator.linearise(x, dt, self._densities)

    def linearised_loops(self) -> LinearisedLoops | None:
        """Compiled loops of `linearise` for steps like those that were linearised so far.

        Returns
        -------
        LinearisedLoops or None
            None without compiled code, or before the first step.
        """
        return self._integrator.linearised_loops(self._densities)

    @property
    def linearised_scan(self) -> LinearisedScan:
        """`linearise` of many points side by side, for other compiled code to call."""
        return self._integrator.linearised_scan

    def steps_scan(self) -> StepsScan | None:
        """Compiled scan of `linearise_steps`.

        Returns
        -------
        StepsScan or None
            None without compiled code.
        """
        return _steps_scan(self._many, self.noise)

    def step_loops(self) -> StepLoops | None:
        """Compiled loops of `step` for many points.

        Returns
        -------
        StepLoops or None
            None without compiled code.
        """
        return self._integrator.step_loops()

    def linearise_steps(
        self,
        here: Float[np.ndarray, "k m"],
        there: Float[np.ndarray, "k m"],
        dt: Float[np.ndarray, " k"],
        about: Float[np.ndarray, "k m"] | None = None,
    ) -> LinearisedSteps:
        """Linearise k steps at once, about their expected ends.

        Parameters
        ----------
        here : ndarray of float, shape (k, m)
            States before the steps.
        dt : ndarray of float, shape (k,)
            Duration of each step, s.
        there : Float[np.ndarray, 'k m']
            Expected ends of the steps; they must hold the mass distribution and other constants of ``here``.
        about : Float[np.ndarray, 'k m'] | None
            States at which the derivatives are taken: those of ``here`` with other constants (inertia, drag);
            None for ``here``.

        Returns
        -------
        LinearisedSteps
            Defects, error transitions and noise factors of all steps.
        """
        return self._many.linearise(here, there, dt, self._densities, about)

    def require_steps(self, time: Float[np.ndarray, " k"], rates: Float[np.ndarray, "k 3"]) -> None:
        """Require that a motion can be integrated within the budget of substeps.

        The budget is `MAX_SUBSTEPS` for one step, and for all steps `MOST_SUBSTEPS` or on average `USUAL_SUBSTEPS`.

        Parameters
        ----------
        time : ndarray of float, shape (k,)
            Stamps, ascending, s.
        rates : ndarray of float, shape (k, 3)
            Body rate at each, rad/s.

        Raises
        ------
        InputError
            The rates need too many substeps; the text names the interval and its turns.
        """
        turned = turns(rates[:-1], np.diff(time))
        if substeps(float(turned.max(initial=0.0)), self._tolerance) <= USUAL_SUBSTEPS:
            return  # nearly always, and long recordings have many steps
        counts = np.array([substeps(turn, self._tolerance) for turn in turned.tolist()])
        if counts.max(initial=0) <= MAX_SUBSTEPS and counts.sum() <= max(
            MOST_SUBSTEPS, USUAL_SUBSTEPS * len(counts)
        ):
            return
        k = int(turned.argmax())
        raise InputError(
            f"the body turns {turned[k] / (2 * np.pi):.3g} times from t = {time[k]:.9g} s to {time[k + 1]:.9g} s, too far to be "
            f"followed at process.tolerance {self._tolerance:g}; correct rates, times or their unit, or cut the recording"
        )

    def noise_covariance(self, x: Float[np.ndarray, " m"], dt: float) -> Float[np.ndarray, "n n"]:
        """Q (n, n) of the multiplicative error over dt s from x.

        Parameters
        ----------
        x : ndarray of float, shape (m,)
            Point before the step.
        dt : float
            Duration, s; positive.

        Returns
        -------
        ndarray of float, shape (n, n)
            Covariance of the error that disturbances add.
        """
        factor = self.linearise(x, dt).noise_factor
        return factor @ factor.T

    @property
    def _densities(self) -> Float[np.ndarray, " p"]:
        """In the order of the table, as ``densities`` of `RotationIntegrator.linearise`."""
        return _in_order_of_table(self.noise)

    @property
    def _disturbed_densities(self) -> Float[np.ndarray, " b"]:
        """Density of each component of the impulses."""
        psd, columns = self.noise.densities, self.impulse_columns.items()
        return np.concatenate([np.full(at.stop - at.start, psd[_NAMED[name].option]) for name, at in columns])


def _in_order_of_table(noise: ProcessNoise) -> Float[np.ndarray, " p"]:
    return np.array(list(noise.densities.values()))


_NAMED = {each.name: each for each in DISTURBANCES}


class DisturbedSteps:
    """Disturbed steps of one or many states, integrated by a `RotationIntegrator`.

    Half a step's white disturbance acts before each step, half after it (Strang splitting), each as an impulse: a jump of the
    numbers of its block, such as the body rate or the velocity, along the axes in which these are.
    """

    def __init__(self, layout: StateLayout, integrator: RotationIntegrator) -> None:
        self._layout = layout
        self._integrator = integrator
        self._compiled_steps = lru_cache(maxsize=None)(self._build)

    @property
    def impulse_columns(self) -> dict[str, slice]:
        """Components of the impulses that belong to each disturbance, one an axis."""
        places, end = {}, 0
        for name in noise_columns(self._layout.blocks):
            places[name] = slice(end, end + len(_NAMED[name].axes))
            end = places[name].stop
        return places

    @property
    def impulse_dim(self) -> int:
        """Components of the impulses."""
        return max(at.stop for at in self.impulse_columns.values())

    def run(
        self, x: Float[np.ndarray, "*batch m"], h: float, impulses: Float[np.ndarray, "n *batch 2 b"]
    ) -> Float[np.ndarray, "*batch m"]:
        """Points after n steps of h > 0 seconds.

        Parameters
        ----------
        impulses : Float[np.ndarray, 'n *batch 2 b']
            What each disturbance adds to its block before and after each step, in `impulse_columns`.
        """
        flat = impulses.reshape(*impulses.shape[:-2], -1)
        columns = flat[0] if len(flat) == 1 else np.moveaxis(flat, 0, -1)  # one column is a vector
        count = self._integrator.first_count(x, h)
        while True:
            after, error = self._compiled_steps(count, len(impulses))(x, h, columns)
            if self._integrator.good(error, count):
                return after
            count *= 2

    def path(
        self, x: Float[np.ndarray, " m"], h: float, impulses: Float[np.ndarray, "n k 2 b"]
    ) -> Float[np.ndarray, "n_plus_1 m"]:
        """The point x of one motion and those after every k steps of h > 0 seconds; see `run`."""
        return self._paths(x[np.newaxis], h, impulses[np.newaxis], self._steps_one_by_one)[0]

    def paths(
        self, x: Float[np.ndarray, "r m"], h: float, impulses: Float[np.ndarray, "r n k 2 b"]
    ) -> Float[np.ndarray, "r n_plus_1 m"]:
        """`path` of many motions, the bits of which do not depend on those beside it."""
        steps = self._steps_side_by_side if self._scan.is_c else self._steps_one_by_one
        return self._paths(x, h, impulses, steps)

    def _paths(
        self,
        x: Float[np.ndarray, "r m"],
        h: float,
        impulses: Float[np.ndarray, "r n k 2 b"],
        steps: _PathSteps,
    ) -> Float[np.ndarray, "r n_plus_1 m"]:
        runs, intervals, each = impulses.shape[:3]
        filled = -(-intervals // INTERVALS_PER_CALL) * INTERVALS_PER_CALL
        flat = impulses.reshape(runs, intervals, each, -1)
        if filled > intervals:
            flat = np.concatenate([flat, np.zeros((runs, filled - intervals, *flat.shape[2:]))], axis=1)
        points, q = [x[:, np.newaxis]], self._layout.mean_slice(ATTITUDE.name)
        for begin in range(0, filled, INTERVALS_PER_CALL):
            taken = flat[:, begin : begin + INTERVALS_PER_CALL]
            part = self._path_parts(points[-1][:, -1], h, taken, steps)
            part[..., q] /= np.linalg.norm(part[..., q], axis=-1, keepdims=True)
            points.append(part)
        return np.concatenate(points, axis=1)[:, : 1 + intervals]

    def _path_parts(
        self,
        x: Float[np.ndarray, "r m"],
        h: float,
        impulses: Float[np.ndarray, "r n k b"],
        steps: _PathSteps,
    ) -> Float[np.ndarray, "r n m"]:
        """A part of each path, with the substeps that it needs by itself."""
        made = np.empty((len(x), impulses.shape[1], x.shape[1]))
        counts = self._integrator.counts_at(self._integrator.speeds(x), np.full(len(x), h))
        left = np.arange(len(x))
        while left.size:
            coarse = []
            for count in np.unique(counts[left]).tolist():
                rows = left[counts[left] == count]
                made[rows], error = steps(x[rows], h, impulses[rows], count)
                good = self._integrator.are_good(error.reshape(len(rows), -1), count)
                coarse += rows[~good].tolist()
            left = np.array(coarse, dtype=np.int64)
            counts[left] *= 2
        return made

    def _steps_one_by_one(
        self, x: Float[np.ndarray, "r m"], h: float, impulses: Float[np.ndarray, "r n k b"], count: int
    ) -> tuple[Float[np.ndarray, "r n m"], Float[np.ndarray, " r"]]:
        """`_steps_side_by_side`, each path by itself."""
        intervals, each = impulses.shape[1:3]
        columns = np.swapaxes(impulses.reshape(len(x), intervals * each, -1), 1, 2)
        after, error = self._compiled_steps(count, intervals * each, each)(x, h, columns)
        return np.swapaxes(after, 1, 2), error.reshape(len(x), -1).max(axis=1)

    def _steps_side_by_side(
        self, x: Float[np.ndarray, "r m"], h: float, impulses: Float[np.ndarray, "r n k b"], count: int
    ) -> tuple[Float[np.ndarray, "r n m"], Float[np.ndarray, " r"]]:
        """Points of each path after every k steps of ``count`` substeps, and the largest error of a step."""
        made = np.empty((len(x), impulses.shape[1], x.shape[1]))
        at, worst, error = np.array(x), np.zeros((len(x), 1)), np.empty((len(x), 1))
        impulse, steps = np.empty((len(x), impulses.shape[3])), np.moveaxis(impulses, 0, 2)
        given, numbers = (
            (at, impulse, np.array([[h]]), np.array([[h / count]])),
            substep_numbers(count)[:, 1:],
        )
        step = self._scan.bound(given, (at, error), np.ascontiguousarray(numbers))
        assert step is not None
        for k, kicks in enumerate(steps):
            for kick in kicks:
                impulse[:] = kick
                step()  # at is the next point
                np.maximum(worst, error, out=worst)
            made[:, k] = at
        return made, worst[:, 0]

    @built_property
    def _scan(self) -> VectorisedScan:
        """One disturbed step of many points side by side.

        Inputs: points, their impulses, of all of them h and the duration of a substep. Outputs: points after the step, and its
        error.
        """
        x, h, short = ca.SX.sym("x", self._layout.mean_dim), ca.SX.sym("h"), ca.SX.sym("short")
        impulse, numbers = ca.SX.sym("impulse", 2 * self.impulse_dim), ca.SX.sym("numbers", 1)
        before, behind = ca.vertsplit(impulse, self.impulse_dim)
        into, expressions = self._impulses_into(), self._integrator.expressions
        values = self._layout.unpack(x + into @ before)
        rotation, parameters = (
            ca.vertcat(values["q"], values["w"]),
            rotation_parameters(self._layout, values),
        )
        state, p, substep = ca.SX.sym("state", 14), ca.SX.sym("p", parameters.numel()), expressions.substep()
        fine, coarse = ca.vertsplit(state, 7)
        after = expressions.translated(values, fine[:4], fine[4:], h) + into @ behind
        given = [x, impulse, h, short]
        return VectorisedScan(
            ca.Function("begin_disturbed", given, [ca.vertcat(rotation, rotation), parameters, short]),
            ca.Function(
                "disturbed_substeps",
                [state, p, short, numbers],
                [ca.vertcat(substep(fine, p, short), substep(coarse, p, numbers * short))],
            ),
            ca.Function("end_disturbed", [*given, state], [after, rotation_difference(coarse, fine) / 15]),
        )

    def _impulses_into(self) -> ca.DM:
        """Where impulses enter a point: rows of each block's axes, columns of its disturbance."""
        into = ca.DM.zeros(self._layout.mean_dim, self.impulse_dim)
        for name, at in self.impulse_columns.items():
            first = self._layout.mean_slice(_NAMED[name].block).start
            into[[first + axis for axis in _NAMED[name].axes], at] = ca.DM.eye(at.stop - at.start)
        return ca.sparsify(into)

    @building()
    def _build(self, count: int, steps: int, kept: int | None = None) -> Compiled:
        """Build ``steps`` steps of ``count`` substeps each.

        Outputs: the last point, or those after every ``kept`` steps, one a column; and the largest integration error of a step.
        """
        dim, into = self.impulse_dim, self._impulses_into()
        x, h = ca.MX.sym("x", self._layout.mean_dim), ca.MX.sym("h")
        impulse = ca.MX.sym("impulse", 2 * dim)
        before, behind = ca.vertsplit(impulse, dim)
        moved, error = self._integrator.expressions.step(count)(x + into @ before, h)
        one = ca.Function("disturbed_step", [x, h, impulse], [moved + into @ behind, error])
        impulses = ca.MX.sym("impulses", 2 * dim, steps)
        every, errors = one.mapaccum("disturbed", steps)(x, ca.repmat(h, 1, steps), impulses)
        points = every[:, -1] if kept is None else every[:, kept - 1 :: kept]
        name = f"disturbed_{steps}_{count}" + ("" if kept is None else f"_{kept}")
        return Compiled(ca.Function(name, [x, h, impulses], [points, ca.mmax(errors)]))


@cache
def _integrators(
    layout: StateLayout, tolerance: float
) -> tuple[RotationIntegrator, BatchedLinearisation, DisturbedSteps]:
    """Compiled steps of a layout, cached because building them is slow."""
    integrator = RotationIntegrator(layout, body_acceleration, tolerance)
    return integrator, BatchedLinearisation(layout, integrator), DisturbedSteps(layout, integrator)


@lru_cache(maxsize=64)
def _steps_scan(many: BatchedLinearisation, noise: ProcessNoise) -> StepsScan | None:
    """Scan of linearised steps under disturbances; the same object for the same, for its address does not pickle."""
    return many.steps_scan(_in_order_of_table(noise))
