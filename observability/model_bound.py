"""How well any system is determined: Fisher information and Cramer-Rao bound along a trajectory, with the user's noise and priors.

The unknowns z are all states, unknown inputs (as random walks) and parameters; s are those of the first time. Given s, z is
Gaussian about B s with the covariance P of the process noise that measurements leave: a Kalman filter that begins with P = 0 and
B = I. Its innovations, whitened, are rows of a square root R of the information about s, R' R = I (de Jong 1991, The diffuse
Kalman filter, Ann. Statist. 19). The bound of z is P + B I^-1 B'. Without any prior R may be singular; its null directions are then
what the measurements do not determine, and states that die out do no harm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from observability.cramer_rao import WIDENING, prior_share
from observability.model import model_of
from observability.model_experiment import Course, Experiment
from observability.prior_dependence import PRIOR_ONLY
from spinfilters.core.errors import InputError
from spinfilters.core.linear_algebra import dgeqrf
from spinfilters.io.argument_checks import (
    by_name,
    checked_arguments,
    numbers_by_name,
    one_of,
    optional,
    refuse,
)

SINGULAR: Final = 1e-9
"""Singular values of the scaled root below this share of the largest are 0."""
LOST: Final = 1e-6
"""Share of a row of B along null directions that is more than rounding."""
LARGEST_DIFFERENCE: Final = 1e-3
"""Between the information of the slopes and that of finite moves, relative, that is not worth a word."""
PARTS: Final = 16
"""Times an interval at which outputs are looked at for aliasing."""
MOST_INTERVALS: Final = 64
"""Intervals that are looked at."""
TIMES_SHOWN: Final = 500
"""Times after which progress is reported."""


@dataclass(frozen=True)
class ModelBound:
    """Cramer-Rao bound of all unknowns at every time; printed, a table.

    Attributes
    ----------
    experiment : Experiment
        What was asked.
    roots : ndarray of shape (t, n, n)
        Square roots of the information about the unknowns at the first time, with all measurements up to each time.
    slopes : ndarray of shape (t, n, n)
        B: what the unknowns of each time are expected to be, by those of the first time.
    remainders : ndarray of shape (t, n, n)
        P: covariance of the process noise that the measurements leave.
    """

    experiment: Experiment
    roots: Float[np.ndarray, "t n n"]
    slopes: Float[np.ndarray, "t n n"]
    remainders: Float[np.ndarray, "t n n"]

    @property
    def names(self) -> tuple[str, ...]:
        """States, unknown inputs, parameters."""
        return self.experiment.names

    @cached_property
    def covariances(self) -> Float[np.ndarray, "t n n"]:
        """Bounds of the covariance; infinite where the information is singular."""
        return self.remainders + _covariances(self.roots, self.slopes)

    @property
    def std(self) -> Float[np.ndarray, "t n"]:
        """Smallest possible standard deviations at every time."""
        return np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))

    @property
    def final(self) -> dict[str, float]:
        """Smallest possible standard deviations at the last time, by name of the unknown."""
        return dict(zip(self.names, self.std[-1].tolist(), strict=True))

    @property
    def priors(self) -> dict[str, float]:
        """Standard deviations known beforehand, those of an earlier experiment included."""
        own = dict(self.experiment.priors)
        earlier = self.experiment.after
        while earlier is not None:
            own |= {name: each for name, each in earlier.priors.items() if name in earlier.model.parameters}
            earlier = earlier.after
        return own

    @cached_property
    def prior_only(self) -> list[dict[str, float]]:
        """Directions of the unknowns at the first time, in deviations of the priors (without one, of the value), hardly improved.

        A direction of information p of the prior and d of the data keeps the share sqrt(p / (p + d)); priors ten times as wide show
        the share (`WIDENING`). Without a prior, a direction of no information.
        """
        free = self.experiment.free
        names = [self.names[k] for k in free]
        values = dict(zip(self.names, self.experiment.start().tolist(), strict=True))
        scale = np.array([self.priors.get(name, abs(values[name]) or 1.0) for name in names])
        narrow, wide = (
            root[:, free] * scale
            for root in (
                self.roots[-1],
                filtered(self.experiment, WIDENING if self.priors else 1.0).roots[-1],
            )
        )
        shares, directions = _remaining_shares(narrow, wide) if self.priors else _null_shares(narrow)
        found = [directions[:, k] for k in np.flatnonzero(shares >= PRIOR_ONLY)]
        return [
            {
                name: float(part)
                for name, part in zip(names, each / each[np.abs(each).argmax()], strict=True)
                if abs(part) > 0.05
            }
            for each in found
        ]

    @cached_property
    def cross_check(self) -> float | None:
        """Largest relative difference between the information of the slopes and of finite moves; None along a recording."""
        if self.experiment.trajectory:
            return None
        free = np.ix_(self.experiment.free, self.experiment.free)
        moved, slopes = empirical_information(self)[free], start_information(self.experiment)[free]
        scale = np.sqrt(np.diagonal(slopes))
        scale[scale == 0] = np.inf
        return float(np.abs((moved - slopes) / np.outer(scale, scale)).max(initial=0.0))

    @cached_property
    def aliased(self) -> dict[str, float]:
        """Outputs that move faster than half their rate, with this rate in Hz.

        More than half of their power, seen `PARTS` times as often, lies above.
        """
        own = self.experiment
        intervals = np.diff(own.times[: MOST_INTERVALS + 1])
        if own.model.discrete or len(intervals) < 8:
            return {}
        outputs, found = own.outputs_between(len(intervals), PARTS), {}
        window = np.hanning(len(outputs))
        frequencies = np.fft.rfftfreq(len(outputs), float(np.median(intervals)) / PARTS)
        for index, name in enumerate(own.model.outputs):
            if name not in own.noise or not np.isfinite(outputs[:, index]).all():
                continue
            power = np.abs(np.fft.rfft((outputs[:, index] - outputs[:, index].mean()) * window)) ** 2
            rate = 1 / (float(np.median(intervals)) * own.every.get(name, 1))
            if (
                power[frequencies > rate / 2].sum() > 0.5 * power.sum()
                and np.ptp(outputs[:, index]) > own.noise[name]
            ):
                found[name] = rate
        return found

    @property
    def sentences(self) -> list[str]:
        """The whole text."""
        last = self.experiment.times[-1]
        unit = "" if self.experiment.model.discrete else " s"
        lines = [
            f"{self.experiment.model.name}: Cramer-Rao bound at t = {last:g}{unit}, standard deviations:"
        ]
        for name, value in self.final.items():
            lines.append(f"  {name:20} {value:.4g}" if np.isfinite(value) else f"  {name:20} not determined")
        for each in self.prior_only:
            stated = [name in self.priors for name in each]
            unit = ", relative to the values" if not any(stated) else ", in deviations of the priors"
            unit += "" if all(stated) or not any(stated) else " or else of the values"
            words = " ".join(f"{part:+.3g} {name}" for name, part in each.items())
            lines.append(f"Not determined by the measurements{unit}: {words}.")
        for name, rate in self.aliased.items():
            lines.append(
                f"Aliasing: {name} moves faster than half its rate of {rate:.4g} Hz; frequencies that differ by a multiple of this "
                "rate give the same samples."
            )
        if self.cross_check is not None and self.cross_check > LARGEST_DIFFERENCE:
            lines.append(
                f"Finite moves disagree by {self.cross_check:.2g} of the information: the outputs bend within such a move."
            )
        return lines

    def __str__(self) -> str:
        """The sentences, one a line."""
        return "\n".join(self.sentences)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{self._number_text(self.priors.get(name))}</td><td>{self._number_text(value)}</td></tr>"
            for name, value in self.final.items()
        )
        words = "".join(f"<p>{escape(line)}</p>" for line in self.sentences if not line.startswith("  "))
        return f"{words}<table><tr><th>unknown</th><th>prior</th><th>bound</th></tr>{rows}</table>"

    @staticmethod
    def _number_text(value: float | None) -> str:
        if value is None:
            return "-"
        return f"{value:.4g}" if np.isfinite(value) else "not determined"

    def document(self) -> dict[str, Any]:
        """The bound for JSON; what is infinite is null."""
        return {
            "model": self.experiment.model.name,
            "times": self.experiment.times.tolist(),
            "std": {
                name: [float(each) if np.isfinite(each) else None for each in self.std[:, k]]
                for k, name in enumerate(self.names)
            },
            "priors": self.priors,
            "prior_only": self.prior_only,
            "aliased": self.aliased,
            "difference_from_finite_moves": self.cross_check,
        }


def _times(name: str, value: Any) -> None:
    """Numbers in a row."""
    try:
        if np.asarray(value, dtype=float).ndim == 1:
            return
    except (TypeError, ValueError):
        pass
    refuse(name, value, "times in s, increasing, as a list or an array")


_NUMBERS: Final = 'numbers by name, such as {"x": 0.1}'
_COURSES: Final = by_name("functions of time, numbers or lists of numbers by name")


@checked_arguments(
    values=numbers_by_name(_NUMBERS),
    noise=numbers_by_name('standard deviations by output, such as {"y": 0.1}'),
    times=_times,
    priors=optional(numbers_by_name(_NUMBERS)),
    process_noise=optional(numbers_by_name(_NUMBERS)),
    inputs=optional(_COURSES),
    every=optional(numbers_by_name('whole numbers by output, such as {"y": 2}')),
    trajectory=optional(_COURSES),
    after=optional(one_of(ModelBound, cure="what bound returned for an earlier experiment")),
)
def bound(
    model: Any,
    values: Mapping[str, float],
    noise: Mapping[str, float],
    times: Sequence[float] | Float[np.ndarray, " t"],
    priors: Mapping[str, float] | None = None,
    process_noise: Mapping[str, float] | None = None,
    inputs: Mapping[str, Course] | None = None,
    every: Mapping[str, int] | None = None,
    trajectory: Mapping[str, Course] | None = None,
    after: ModelBound | None = None,
) -> ModelBound:
    """How well measurements can determine a model's states and parameters along a trajectory.

    Parameters
    ----------
    model : Mapping or Model
        A dictionary of formulas, as of `analyse`; of CasADi expressions `observability.model.model_of_expressions` makes a model.
    values : Mapping[str, float]
        True states at the first time, parameters, known constants and unknown inputs.
    noise : Mapping[str, float]
        Standard deviation of each output that is measured; others are left out.
    times : array of shape (t,)
        Of the measurements, s, for example those of a recording.
    priors, process_noise, inputs, every, trajectory : Mapping
        See `Experiment`.
    after : ModelBound
        Of an earlier experiment with the same parameters, which are known from it.

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
        dict(trajectory or {}),
        after.experiment if after is not None else None,
    )
    return bound_of(experiment)


def bound_of(experiment: Experiment) -> ModelBound:
    """The bound of an experiment.

    Raises
    ------
    InputError
        Where nothing is measured, or the trajectory leaves the numbers.
    """
    if not experiment.noise:
        raise InputError(
            f"{experiment.model.name}: nothing is measured; give noise, a standard deviation by output"
        )
    return filtered(experiment)


def filtered(experiment: Experiment, widening: float = 1.0) -> ModelBound:
    """The bound with priors so many times as wide."""
    course, size = experiment.course, len(experiment.names)
    root, slope = _root_at_start(experiment, widening), experiment.start_slopes()
    left = np.zeros((size, size))
    noisy = any(each.size for each in course.entries)
    roots, slopes, remainders = [], [], []
    for k in range(len(experiment.times)):
        if k:
            transition, entry = course.transitions[k - 1], course.entries[k - 1]
            slope = transition @ slope
            if noisy:
                left = transition @ left @ transition.T + entry @ entry.T
        rows = []
        for index, deviation in experiment.measured(k):
            output = course.slopes[k, index]
            carried, spread = output @ slope, left @ output
            variance = output @ spread + deviation**2
            rows.append(carried[np.newaxis] / np.sqrt(variance))
            if noisy:
                gain = spread[:, np.newaxis] / variance
                slope = slope - gain * carried
                left = left - gain * spread
        if rows:
            root = _triangle(np.concatenate([root, *rows]), size)
        roots.append(root)
        slopes.append(slope)
        remainders.append(left)
        if k % TIMES_SHOWN == TIMES_SHOWN - 1:
            experiment.progress("bound", k + 1, len(experiment.times))
    return ModelBound(experiment, np.stack(roots), np.stack(slopes), np.stack(remainders))


def _root_at_start(experiment: Experiment, widening: float) -> Float[np.ndarray, "n n"]:
    """Of the priors, and of the parameters from an earlier experiment."""
    names, parameters = experiment.names, experiment.model.parameters
    known = {
        name: each
        for name, each in experiment.priors.items()
        if experiment.after is None or name not in parameters
    }
    root = np.diag([1 / (widening * known[name]) if name in known else 0.0 for name in names])
    if experiment.after is None or not parameters:
        return root
    # [ states | parameters ]: the lower right block of the triangle is the root of the parameters' marginal.
    whole, count = filtered(experiment.after, widening).roots[-1], len(parameters)
    root[-count:, -count:] = whole[-count:, -count:]
    return root


def start_information(experiment: Experiment) -> Float[np.ndarray, "n n"]:
    """Information of the measurements alone about the unknowns at the first time, without process noise."""
    course, size = experiment.course, len(experiment.names)
    carried, found = experiment.start_slopes(), np.zeros((size, size))
    for k in range(len(experiment.times)):
        if k:
            carried = course.transitions[k - 1] @ carried
        for index, deviation in experiment.measured(k):
            row = course.slopes[k, index] @ carried / deviation
            found += np.outer(row, row)
    return found


@checked_arguments(
    found=one_of(ModelBound, cure="what bound returned"),
    manoeuvres=optional(by_name('inputs by manoeuvre, such as {"hard": {"u": 2}}', _COURSES)),
)
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
        By sensor or manoeuvre, then by unknown; infinity where the unknown is determined by it alone, below 1 where a manoeuvre
        is worse, and 0 where with it the unknown is not determined any more.
    """
    own, table = found.experiment, {}
    sensors = dict.fromkeys(name for each in _flights(own) for name in each.noise)
    for name in sensors:
        other = _without_sensor(own, name)
        table[name] = _ratios(filtered(other).final, found.final)
    for name, inputs in (manoeuvres or {}).items():
        moved = bound_of(replace(own, inputs={**own.inputs, **inputs}))
        table[name] = _ratios(found.final, moved.final)
    return table


def _flights(experiment: Experiment) -> list[Experiment]:
    """An experiment and those before it."""
    return [experiment, *(_flights(experiment.after) if experiment.after is not None else [])]


def _without_sensor(experiment: Experiment, name: str) -> Experiment:
    others = {key: each for key, each in experiment.noise.items() if key != name}
    after = _without_sensor(experiment.after, name) if experiment.after is not None else None
    return replace(experiment, noise=others, after=after)


def _ratios(without: Mapping[str, float], with_it: Mapping[str, float]) -> dict[str, float]:
    """1 where both are infinite, or both 0."""
    return {
        name: 1.0 if without[name] == each else float(np.divide(without[name], each))
        for name, each in with_it.items()
    }


def empirical_information(found: ModelBound, share: float = 1e-4) -> Float[np.ndarray, "n n"]:
    """Information about the unknowns at the first time by finite moves: the empirical Gramian over the noise.

    Every unknown is moved there and back by a share of its prior (of itself, or 1), the outputs are simulated, and differences
    squared and summed (Lall, Marsden and Glavaski 2002, Int. J. Robust Nonlinear Control 12). There is no process noise in it.
    """
    own = found.experiment
    base = own.start()
    sizes = share * np.array(
        [found.priors.get(name, abs(each) or 1.0) for name, each in zip(own.names, base, strict=True)]
    )
    moves = np.diag(sizes)
    there, back = np.split(own.simulated(np.vstack([base + moves, base - moves])), 2)
    slopes = (there - back) / (2 * sizes[:, np.newaxis])
    return slopes @ slopes.T


def _triangle(stacked: Float[np.ndarray, "k n"], size: int) -> Float[np.ndarray, "n n"]:
    factored = np.asarray(dgeqrf(stacked)[0])  # at least as many rows as columns: the roots before are square
    return np.triu(factored[:size])


def _covariances(
    roots: Float[np.ndarray, "t n n"], slopes: Float[np.ndarray, "t n n"]
) -> Float[np.ndarray, "t n n"]:
    """B (R' R)^-1 B' at every time, infinite in what the null directions of R move."""
    scale, sizes, axes, null = _scaled_singular_values(roots)
    scaled = slopes / scale[:, np.newaxis]
    along = scaled @ axes.swapaxes(1, 2)
    kept = along * np.where(null, 0.0, 1 / np.where(null, 1.0, sizes))[:, np.newaxis]
    covariances = kept @ kept.swapaxes(1, 2)
    moved = np.abs(along) > LOST * np.linalg.norm(scaled, axis=2)[:, :, np.newaxis]
    times, lost = np.nonzero((moved & null[:, np.newaxis]).any(axis=2))
    covariances[times, lost, lost] = np.inf
    return covariances


def _null_shares(root: Float[np.ndarray, "n m"]) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
    """Right singular vectors, with share 1 where there is no information."""
    scale, _, axes, null = _scaled_singular_values(root)
    return null.astype(float), axes.T / scale[:, np.newaxis]


def _scaled_singular_values(
    root: Float[np.ndarray, "*t n m"],
) -> tuple[
    Float[np.ndarray, "*t m"],
    Float[np.ndarray, "*t m"],
    Float[np.ndarray, "*t m m"],
    Bool[np.ndarray, "*t m"],
]:
    """Lengths of a root's columns; singular values of the root over them, right singular vectors, and which values are zero."""
    scale = np.linalg.norm(root, axis=-2)
    scale[scale == 0] = 1.0
    _, sizes, axes = np.linalg.svd(root / scale[..., np.newaxis, :])
    return scale, sizes, axes, sizes <= SINGULAR * np.maximum(sizes[..., :1], 1e-300)


def _remaining_shares(
    narrow: Float[np.ndarray, "n m"], wide: Float[np.ndarray, "n m"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
    """Shares of the priors that remain, and directions; 1 where there is no information at all.

    Along D with I = D^-T D^-1 of the narrow priors, D' I_wide D has the eigenvalues one over what a variance grows by; the share
    of a growth is `observability.cramer_rao.prior_share`.
    """
    scale, sizes, axes, null = _scaled_singular_values(narrow)
    axes = axes / scale
    unit = (axes[~null] / sizes[~null, np.newaxis]).T
    _, kept, turned = np.linalg.svd(wide @ unit)
    shares = prior_share((1 / np.maximum(kept, 1e-12) ** 2).clip(1.0))
    return np.concatenate([shares, np.ones(null.sum())]), np.hstack([unit @ turned.T, axes[null].T])
