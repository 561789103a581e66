"""The body that a belief describes: principal moments, axes, centre of mass and drag, with their uncertainties.

The state holds the mass distribution in axes g (`spinfilters.core.mass_distribution`); principal moments
are the eigenvalues of J and principal axes its eigenvectors. Covariances of what is well known are of first order,

    d lambda_k = u_k' dJ u_k,   d u_k = sum over j != k of u_j (u_j' dJ u_k) / (lambda_k - lambda_j),

with dJ by the error of the state; all others are integrals over the belief (`body_spread`), widened to a quarter of what the
quantity departs by within four deviations of the belief (`widest_departures`) where that is more. The moments are sorted: where two
agree within their uncertainty, the estimated gap is biased outwards.
"""

from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.attitude_conversions import axial_vector, matrix_from_rotation_vector
from spinfilters.core.compiled import Compiled
from spinfilters.core.conventions import PerRun
from spinfilters.core.linear_algebra import by_stretches, with_largest_positive
from spinfilters.core.mass_distribution import inertia, inertia_matrices
from spinfilters.models.body_spread import axis_turns, body_spread, widest_departures
from spinfilters.models.state_blocks import CENTRE_OF_MASS, DRAG, StateBlock
from spinfilters.models.state_layout import Gaussian, StateLayout, with_error_jacobian

UNDETERMINED_STD: Final[float] = np.pi / np.sqrt(12.0)
"""Standard deviation in rad of an axis of which nothing is known: an angle uniform over half a turn."""
FIRST_ORDER_STD: Final[float] = 0.003
"""Largest standard deviation of the logarithm of second moments, and of an axis in rad, for which derivatives are enough."""
INTERVAL: Final = (0.025, 0.975)
"""Levels of the interval of sampled moments."""
_TAILS = np.array([4.0, 3.0, 2.0, 2.0, 3.0, 4.0])  # of a normal distribution, and the probability below each
_TAIL_LEVELS = np.array([0.00003167, 0.00134990, 0.02275013, 0.97724987, 0.99865010, 0.99996833])
_MEAN_STEPS = 3  # of the mean of rotations: what is left is 1e-5 of samples 0.1 rad wide
_SMALLEST_GAP = 1e-12  # of moments, relative to the largest: below it rounding decides


@dataclass(frozen=True)
class BodyEstimate:
    """Body properties of one belief, or of the beliefs of many runs: every array then has an axis (r,) in front.

    Attributes
    ----------
    principal_moments : Float[np.ndarray, '3']
        (3,) ascending, largest = 1; only ratios show in torque-free motion.
    principal_moments_cov : Float[np.ndarray, '3 3']
        (3, 3), its last row and column zero.
    principal_axes_g : Float[np.ndarray, '3 3']
        (3, 3) rows are unit axes in g, right-handed, row k belongs to moment k: R_bg.
    principal_axes_cov : Float[np.ndarray, '3 3']
        (3, 3) rad^2 of the small rotation of these axes about themselves; the standard deviation of an axis that
        is not determined (equal moments) is `UNDETERMINED_STD`.
    k1, k2, k1_std, k2_std : PerRun
        ln(Jmax / Jmid), ln(Jmid / Jmin) (Tweddle 2013, Eqs 4.97-4.98, x major, z minor).
    center_of_mass_g, center_of_mass_std : Float[np.ndarray, '3'] | None
        (3,) m, None where the state has none.
    drag, drag_std : PerRun | None
        1/rad, None where the state has none.
    principal_moments_interval : Float[np.ndarray, '3 2'] | None
        Central 95 % of the moments' posterior where that was sampled (`MassSamples`), None elsewhere.
    """

    principal_moments: Float[np.ndarray, "*r 3"]
    principal_moments_cov: Float[np.ndarray, "*r 3 3"]
    principal_axes_g: Float[np.ndarray, "*r 3 3"]
    principal_axes_cov: Float[np.ndarray, "*r 3 3"]
    k1: PerRun
    k2: PerRun
    k1_std: PerRun
    k2_std: PerRun
    center_of_mass_g: Float[np.ndarray, "*r 3"] | None
    center_of_mass_std: Float[np.ndarray, "*r 3"] | None
    drag: PerRun | None
    drag_std: PerRun | None
    principal_moments_interval: Float[np.ndarray, "3 2"] | None = None

    @property
    def principal_moments_std(self) -> Float[np.ndarray, "*r 3"]:
        """Standard deviations of the moments; the last is zero by the choice of scale."""
        return np.sqrt(np.diagonal(self.principal_moments_cov, axis1=-2, axis2=-1))

    @property
    def principal_axes_std(self) -> Float[np.ndarray, "*r 3"]:
        """Standard deviations in rad of the rotation about each principal axis."""
        return np.sqrt(np.diagonal(self.principal_axes_cov, axis1=-2, axis2=-1))

    @property
    def shape(self) -> Float[np.ndarray, "*r 4"]:
        """Moments that are not 1 by definition, and log ratios."""
        return np.array([*self.principal_moments[:2], self.k1, self.k2])

    @property
    def shape_std(self) -> Float[np.ndarray, "*r 4"]:
        """Standard deviations of `shape`."""
        return np.array([*self.principal_moments_std[:2], self.k1_std, self.k2_std])

    def of_run(self, run: int) -> "BodyEstimate":
        """The body of one run, of those of many."""
        held = {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(self, **{name: value[run] for name, value in held.items() if value is not None})


@dataclass(frozen=True)
class BodyHistory:
    """The body after every epoch: fields as in `BodyEstimate`, with an epoch axis (n,) in front.

    ``time`` is in s; ``log_ratios`` and ``log_ratios_std`` are (n, 2) and hold k1, k2.
    """

    time: Float[np.ndarray, " n"]
    principal_moments: Float[np.ndarray, "n 3"]
    principal_moments_cov: Float[np.ndarray, "n 3 3"]
    principal_axes_g: Float[np.ndarray, "n 3 3"]
    principal_axes_cov: Float[np.ndarray, "n 3 3"]
    log_ratios: Float[np.ndarray, "n 2"]
    log_ratios_std: Float[np.ndarray, "n 2"]
    center_of_mass_g: Float[np.ndarray, "n 3"] | None
    center_of_mass_std: Float[np.ndarray, "n 3"] | None
    drag: Float[np.ndarray, " n"] | None
    drag_std: Float[np.ndarray, " n"] | None

    @property
    def principal_moments_std(self) -> Float[np.ndarray, "n 3"]:
        """Standard deviations of the moments."""
        return np.sqrt(np.einsum("nii->ni", self.principal_moments_cov))

    @property
    def together(self) -> BodyEstimate:
        """The bodies as those of many runs, of which each has left one epoch."""
        return BodyEstimate(
            self.principal_moments,
            self.principal_moments_cov,
            self.principal_axes_g,
            self.principal_axes_cov,
            self.log_ratios[:, 0],
            self.log_ratios[:, 1],
            self.log_ratios_std[:, 0],
            self.log_ratios_std[:, 1],
            self.center_of_mass_g,
            self.center_of_mass_std,
            self.drag,
            self.drag_std,
        )

    def at(self, index: int) -> BodyEstimate:
        """The body after the epoch of this index."""
        (k1, k2), (k1_std, k2_std) = self.log_ratios[index].tolist(), self.log_ratios_std[index].tolist()
        return BodyEstimate(
            self.principal_moments[index],
            self.principal_moments_cov[index],
            self.principal_axes_g[index],
            self.principal_axes_cov[index],
            k1,
            k2,
            k1_std,
            k2_std,
            None if self.center_of_mass_g is None else self.center_of_mass_g[index],
            None if self.center_of_mass_std is None else self.center_of_mass_std[index],
            None if self.drag is None else float(self.drag[index]),
            None if self.drag_std is None else float(self.drag_std[index]),
        )


@dataclass(frozen=True)
class MassSamples:
    """Weighted samples of a mass distribution that no Gaussian describes.

    Attributes
    ----------
    points : Float[np.ndarray, 'n 5']
        (n, 5) block s of each.
    weights : Float[np.ndarray, ' n']
        (n,) their sum is one.
    gaussian_shape : float
        Pareto shape of the Gaussian belief as a proposal of the samples' density (`spinfilters.core.posterior_sampling`).
    gaussian_nees : float
        Mean NEES per degree of freedom of the samples in the Gaussian belief. It is large where that misses a part of the
        posterior, in which it proposes nothing, which the shape does not show.
    shape : float
        Pareto shape of the samples' own weights.
    """

    points: Float[np.ndarray, "n 5"]
    weights: Float[np.ndarray, " n"]
    gaussian_shape: float
    gaussian_nees: float
    shape: float = 0.0

    @cached_property
    def principal_moments(self) -> Float[np.ndarray, "n 3"]:
        """(n, 3) ascending, largest = 1."""
        moments = np.linalg.eigvalsh(inertia_matrices(self.points))
        return moments / moments[:, 2:]

    @cached_property
    def principal_axes(self) -> Float[np.ndarray, "3 3"]:
        """(3, 3) rows are unit axes in g, right-handed, about which the samples' axes have turns of mean zero."""
        bodies = inertia_matrices(self.points)
        bodies /= np.trace(bodies, axis1=1, axis2=2)[:, np.newaxis, np.newaxis]
        axes = _right_handed(np.linalg.eigh(np.tensordot(self.weights, bodies, 1))[1]).T
        for _ in range(_MEAN_STEPS):
            axes = matrix_from_rotation_vector(self.weights @ self.turns(axes)).T @ axes
        return axes

    def turns(self, axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
        """(n, 3) rad, the shortest rotation about themselves that takes axes, in rows, to those of each sample."""
        vectors = np.linalg.eigh(inertia_matrices(self.points))[1]
        return axis_turns(axes.T[np.newaxis], vectors[np.newaxis])[0]

    def quantiles(
        self, values: Float[np.ndarray, " n"], levels: Float[np.ndarray, " q"]
    ) -> Float[np.ndarray, " q"]:
        """Weighted quantiles of a quantity of the samples."""
        order = np.argsort(values)
        reached = np.cumsum(self.weights[order]) - self.weights[order] / 2
        return np.interp(levels, reached, values[order])

    def deviation(self, values: Float[np.ndarray, " n"], about: float) -> float:
        """Standard deviation of a quantity about a value, not less than its tails at two to four deviations ask for.

        Nearly round bodies have a posterior of their ratios that is narrow but for a long tail, which a mean square hardly sees.
        """
        away = values - about
        tails = np.abs(self.quantiles(away, _TAIL_LEVELS)) / _TAILS
        return float(max(np.sqrt(self.weights @ np.square(away)), tails.max()))

    def body(
        self, belief: BodyEstimate, least_axes_std: Float[np.ndarray, " 3"] | float = 0.0
    ) -> BodyEstimate:
        """A belief's body with mean and deviations of moments and axes over the samples; the centre is the belief's.

        Covariances have the correlations of the samples, and the variances of `deviation`.

        Parameters
        ----------
        least_axes_std : Float[np.ndarray, ' 3'] | float
            Deviations of the axes that their errors have for other reasons, rad.
        """
        moments = self.principal_moments
        logs = np.log(moments[:, [2, 1]] / moments[:, [1, 0]])
        mean = self.weights @ moments
        mean[2] = 1.0  # by definition, which a sum of weights meets to rounding
        ratios = np.log(mean[[2, 1]] / mean[[1, 0]])  # of the published moments; deviations are about these
        stated = np.array([self.deviation(moments[:, k], mean[k]) for k in range(2)])
        turns = self.turns(self.principal_axes)
        axes_std = np.maximum([self.deviation(turn, 0.0) for turn in turns.T], least_axes_std)
        k1_std, k2_std = (self.deviation(logs[:, k], ratios[k]) for k in range(2))
        levels = np.array(INTERVAL)
        return replace(
            belief,
            principal_moments=mean,
            principal_moments_cov=self._covariance(moments - mean, np.append(stated, 0.0)),
            principal_axes_g=self.principal_axes,
            principal_axes_cov=self._covariance(turns, np.minimum(axes_std, UNDETERMINED_STD)),
            k1=float(ratios[0]),
            k2=float(ratios[1]),
            k1_std=k1_std,
            k2_std=k2_std,
            principal_moments_interval=np.array([self.quantiles(column, levels) for column in moments.T]),
        )

    def _covariance(
        self, away: Float[np.ndarray, "n 3"], stated: Float[np.ndarray, " 3"]
    ) -> Float[np.ndarray, "3 3"]:
        """Covariance of departures, with deviations as stated and the correlations of the samples."""
        root = np.sqrt(self.weights)[:, np.newaxis] * away
        covariance = root.T @ root
        spread = np.sqrt(np.diagonal(covariance))
        widened = np.divide(stated, spread, out=np.ones(3), where=spread > 0)
        return covariance * np.outer(widened, widened)


def turn_of_axes(
    axes: Float[np.ndarray, "*n 3 3"], others: Float[np.ndarray, "*n 3 3"]
) -> Float[np.ndarray, "*n 3"]:
    """Small rotation between principal axes, about each of the first, to first order, rad; an axis has no direction.

    Both are matrices with an axis in each row, in the coordinates of g.
    """
    R = axes @ np.swapaxes(others, -1, -2)
    return axial_vector(R * np.sign(np.diagonal(R, axis1=-2, axis2=-1))[..., np.newaxis, :])


def body_estimate(belief: Gaussian, intervals: bool = True) -> BodyEstimate:
    """Body properties of a belief over a layout with block s; see `bodies_of`."""
    arrays = np.zeros(1), belief.mean[np.newaxis], belief.factor[np.newaxis]
    return bodies_of(belief.layout, *arrays, intervals).at(0)


def bodies_of(
    layout: StateLayout, time: np.ndarray, mean: np.ndarray, factor: np.ndarray, intervals: bool = True
) -> BodyHistory:
    """The body of every belief over a layout with block s; NaN where a belief is not finite.

    Parameters
    ----------
    time : np.ndarray
        (n,) s.
    mean, factor : np.ndarray
        (n, m), (n, e, e) of the beliefs.
    intervals : bool
        Whether deviations cover four of the belief; else they are the mean squares of an error alone, as of a
        bound.
    """
    centre, centre_std = _block(layout, CENTRE_OF_MASS, mean, factor)
    drag, drag_std = _block(layout, DRAG, mean, factor)
    return BodyHistory(
        time=time,
        **by_stretches(
            len(time), lambda rows: _inertias(layout, mean[rows], factor[rows], intervals), factor
        ),
        center_of_mass_g=centre,
        center_of_mass_std=centre_std,
        drag=None if drag is None else drag[:, 0],
        drag_std=None if drag_std is None else drag_std[:, 0],
    )


def _inertias(
    layout: StateLayout, mean: np.ndarray, factor: np.ndarray, intervals: bool
) -> dict[str, np.ndarray]:
    """Moments and axes with their covariances, by the names of a `BodyHistory`."""
    J, derivative = _inertia(layout)(mean)
    moments, vectors = _principal(J.reshape(-1, 3, 3))
    vectors = _right_handed(vectors)
    turned = np.einsum("nai,nabe,nbj->nije", vectors, derivative.reshape(len(mean), 3, 3, -1), vectors)
    jacobian = np.einsum("niie->nie", turned) / moments[..., np.newaxis]
    scaled = moments / moments[:, 2:]
    roots = (scaled[..., np.newaxis] * (jacobian - jacobian[:, 2:])) @ factor
    logs = (jacobian[:, [2, 1]] - jacobian[:, [1, 0]]) @ factor
    turns = _axis_turns(moments, turned) @ factor
    found = {
        "principal_moments": scaled,
        "principal_moments_cov": roots @ np.swapaxes(roots, 1, 2),
        "principal_axes_g": np.swapaxes(vectors, 1, 2),
        "principal_axes_cov": turns @ np.swapaxes(turns, 1, 2),
        "log_ratios": np.log(moments[:, [2, 1]] / moments[:, [1, 0]]),
        "log_ratios_std": np.linalg.norm(logs, axis=2),
    }
    vague = _widen(layout, mean, factor, found)
    if intervals and vague.size:
        _cover(mean[vague][:, layout.mean_slice("s")], factor[vague][:, layout.slice("s")], found, vague)
    found["principal_axes_cov"] = _bound_deviations(found["principal_axes_cov"])
    return found


def _widen(
    layout: StateLayout, mean: np.ndarray, factor: np.ndarray, found: dict[str, np.ndarray]
) -> Int[np.ndarray, " v"]:
    """Replace first-order rows by integrals over the belief where needed."""
    masses = factor[:, layout.slice("s")]
    axes_std = np.sqrt(np.einsum("nkk->nk", found["principal_axes_cov"]).max(axis=1))
    widest = np.maximum(np.linalg.norm(masses, axis=(1, 2)), axes_std)
    known = np.isfinite(masses).all(axis=(1, 2)) & np.isfinite(found["principal_moments"]).all(axis=1)
    vague = np.flatnonzero(known & (widest > FIRST_ORDER_STD))
    if not vague.size:
        return vague
    axes = np.swapaxes(found["principal_axes_g"][vague], 1, 2)
    moments, ratios, turns = body_spread(mean[vague][:, layout.mean_slice("s")], masses[vague], axes)
    found["principal_moments_cov"][vague] = moments
    found["log_ratios_std"][vague] = np.sqrt(np.einsum("nkk->nk", ratios))
    undetermined = np.einsum("nkk->nk", found["principal_axes_cov"][vague]) > UNDETERMINED_STD**2
    found["principal_axes_cov"][vague] = _with_std(turns, undetermined)
    return vague


def _cover(
    s: Float[np.ndarray, "v 5"],
    factor: Float[np.ndarray, "v 5 e"],
    found: dict[str, np.ndarray],
    rows: Int[np.ndarray, " v"],
) -> None:
    """Widen standard deviations to a quarter of the departures within four deviations of the belief.

    Moments, log ratios and axes are only ever widened, and correlations are kept (`widest_departures`).
    """
    axes = np.swapaxes(found["principal_axes_g"][rows], 1, 2)
    moments, ratios, turns = widest_departures(s, factor, axes)
    found["log_ratios_std"][rows] = np.fmax(found["log_ratios_std"][rows], ratios)
    for name, departure in (("principal_moments_cov", moments), ("principal_axes_cov", turns)):
        std = np.sqrt(np.einsum("nkk->nk", found[name][rows]))
        share = np.fmax(departure / np.where(std > 0, std, np.inf), 1.0)
        found[name][rows] *= share[:, :, np.newaxis] * share[:, np.newaxis]


def _principal(J: Float[np.ndarray, "n 3 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Principal moments and axes (columns); moments are positive even for a needle, NaN where J is not finite."""
    good = np.asarray(np.isfinite(J).all(axis=(1, 2)))
    moments, vectors = np.linalg.eigh(np.where(good[:, np.newaxis, np.newaxis], J, np.eye(3)))
    moments = np.maximum(
        moments, np.finfo(float).eps * moments[:, 2:]
    )  # a needle's smallest is rounding, of either sign
    moments[~good], vectors[~good] = np.nan, np.nan
    return moments, vectors


def _axis_turns(moments: np.ndarray, turned: np.ndarray) -> Float[np.ndarray, "n 3 e"]:
    """Derivative of the axes' rotation phi in R_gb exp([phi x]): phi_1 = u_3 . du_2 and cyclic, from u_i' dJ u_j."""
    after, last = [1, 2, 0], [2, 0, 1]
    # entry (last, after) of U' dJ U over the difference of the moments gives the turn about the third axis
    gap = moments[:, after] - moments[:, last]
    floor = _SMALLEST_GAP * moments[:, 2:]
    gap = np.where(np.abs(gap) < floor, floor, gap)
    return turned[:, last, after] / gap[..., np.newaxis]


def _bound_deviations(covariance: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The covariance with standard deviations of at most `UNDETERMINED_STD`, correlations kept."""
    std = np.sqrt(np.einsum("nkk->nk", covariance))
    return _scaled(covariance, UNDETERMINED_STD / np.maximum(std, UNDETERMINED_STD))


def _with_std(
    covariance: Float[np.ndarray, "n 3 3"], undetermined: Bool[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """The covariance with the standard deviation of an unknown axis, where so."""
    std = np.sqrt(np.einsum("nkk->nk", covariance))
    return _scaled(
        covariance, np.where(undetermined, UNDETERMINED_STD / np.maximum(std, np.finfo(float).tiny), 1.0)
    )


def _scaled(
    covariance: Float[np.ndarray, "n 3 3"], by: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """The covariance of errors that are so many times larger."""
    return covariance * by[:, :, np.newaxis] * by[:, np.newaxis]


def _right_handed(vectors: np.ndarray) -> Float[np.ndarray, "*n 3 3"]:
    """Eigenvectors (columns) with the first two's largest component positive, third = their product."""
    first, second = (with_largest_positive(vectors[..., k]) for k in range(2))
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _block(
    layout: StateLayout, block: StateBlock, mean: np.ndarray, factor: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
    if not layout.has(block):
        return None, None
    std = np.linalg.norm(factor[:, layout.slice(block.name)], axis=2)
    return mean[:, layout.mean_slice(block.name)], std


@cache
def _inertia(layout: StateLayout) -> Compiled:
    """J (9 x 1) and its derivative (9 x e) by the error of the state."""
    return with_error_jacobian(layout, "inertia_in_g", lambda state: inertia(state["s"]))
