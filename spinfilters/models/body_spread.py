"""Covariance of moments, log ratios and axes by cubature.

Over the Gaussian of the mass distribution.
Derivatives are not enough even for bodies known to a few per cent: a motion determines one combination of the moments far better
than the other, and in that thin direction the curvature of the eigenvalues is larger than the first order. With y what is asked,
at mean [+] (the points), M the mean of (y - y0)(y - y0)' about the published y0 is what an error of y0 is compared with: the bias
of the eigenvalues counts in it. The rule (Stroud 1971, E_n^r2 5-3) has positive weights and is exact to the fifth degree, so that
M is exact for what is quadratic in the error:

    2n points at +-r e_i,  r^2 = (n + 2) / 2,  weight 4 / (n + 2)^2;
    2^n points at s (+-1, ..., +-1),  s^2 = (n + 2) / (n - 2),  weight ((n - 2) / (n + 2))^2 / 2^n.

Intervals of moments, log ratios and axes within four standard deviations of a mass distribution.

A standard deviation is the width of a Gaussian. Where the mass distribution has one, moments and axes have none: the ratio of two
nearly equal moments is a root of a sum of squares, with the tails of a chi-square, their axes turn by an angle whose tangent is a
quotient, and an error of three deviations of the mass distribution was one of five of the ratio. So the ends of

    { y(s [+] F u): |u| <= R },   y = ln (J_min / J_max), ln (J_mid / J_max), ln (J_min / J_mid), turns of the axes,

are sought, the profile likelihood's interval of y at R deviations. At an end u is parallel to the gradient of y by u: u is moved
along it on the sphere as long as y goes on. With D the error of S and w_k = V' L' a_k for an eigenvector a_k of S = L exp(D) L',
D = V diag(l) V',

    a_i' dS/dD a_j = V (Phi o w_i w_j') V',   Phi_ij = (exp l_i - exp l_j) / (l_i - l_j).

The gradients of a needle that is hardly a body lead nowhere. So the sphere and discs about three axes are looked at, too,
wherever they lie within R: with S = U exp(2 M) U' and L = U exp(M) V' they are at D = V (E - 2 M) V', E that of the disc.

An error of y at r deviations of the mass distribution is within r of its own where these are

    max |y(u) - y(0)| / |u|,   |u| <= R,

which is more than a quarter of the farthest departure where y does not grow any further: the estimate of a near-sphere lies
outwards, and J_min / J_max = 1 may be the end at two deviations as well as at four. The estimate of the sphere itself is off it
in all five directions of D: its distance has the distribution of a chi of five degrees of freedom, of which R5 is as improbable
as R of a normal number. So its departure counts R5 / R times.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import product
from typing import Final

import casadi as ca
import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import rotation_vector_from_matrix
from spinfilters.core.c_library import KERNEL_FLAGS, LANES, Signature, load_text, with_signatures
from spinfilters.core.compiled import Compiled, address
from spinfilters.core.mass_distribution import DIMENSION, inertia, retract_mass
from spinfilters.core.working_time import building

WIDEST: Final[float] = 2.0
"""Of a deviation of the mass distribution (log second moments): beyond it are plates and rods alone, and overflow."""
TURNS: Final = np.array([[x, y, x * y] for x, y in product((1.0, -1.0), repeat=2)])
"""Signs of right-handed axes."""
Spread = tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 3 3"]]
"""Covariances of the moments (largest = 1), of their log ratios k1, k2, and of the rotation of the axes about themselves."""


def body_spread(
    s: Float[np.ndarray, "n 5"], factor: Float[np.ndarray, "n 5 e"], axes: Float[np.ndarray, "n 3 3"]
) -> Spread:
    """The covariances about mass distributions s, whose error has the covariance factor factor'; axes are columns.

    Not a number where a body at such a deviation is none to rounding.
    """
    steps = principal_steps(factor)
    points, weights = _cubature()
    library = _library()
    if library is not None:
        given = tuple(
            np.ascontiguousarray(each, dtype=float)
            for each in (_lower_factors(s), steps, axes, points, weights)
        )
        found = tuple(np.empty((len(s), size, size)) for size in (3, 2, 3))
        room = np.empty((len(points), 8))
        library.body_spread(
            len(s), *map(address, given[:3]), len(points), *map(address, (*given[3:], room, *found))
        )
        return found[0], found[1], found[2]
    offsets = np.einsum("pe,nke->npk", points, steps)
    J = _moved_inertia()(np.repeat(s[:, np.newaxis], offsets.shape[1], 1), offsets)[0].reshape(
        len(s), -1, 3, 3
    )
    bodies = np.asarray(np.isfinite(J).all(axis=(1, 2, 3)))
    moments, vectors = np.linalg.eigh(np.where(bodies[:, np.newaxis, np.newaxis, np.newaxis], J, np.eye(3)))
    bodies &= (moments > 0).all(axis=(1, 2))
    moments[~bodies] = np.nan
    scaled = moments / moments[..., 2:]
    ratios = np.log(moments[..., [2, 1]] / moments[..., [1, 0]])
    turns = axis_turns(axes, vectors)
    return _covariance(scaled, weights), _covariance(ratios, weights), _covariance(turns, weights)


def principal_steps(
    factor: Float[np.ndarray, "n 5 e"], sphere: Float[np.ndarray, "n 5"] | float = 0.0
) -> Float[np.ndarray, "n 5 5"]:
    """Principal directions of a covariance as columns, of the length of their deviations up to `WIDEST`.

    Parameters
    ----------
    sphere : Float[np.ndarray, 'n 5'] | float
        Errors that lead there; lengths are up to half of that, too, so that a needle may be anything else.
    """
    directions, deviations, _ = np.linalg.svd(factor, full_matrices=False)
    widest = np.maximum(np.linalg.norm(np.atleast_2d(sphere), axis=1) / 2, WIDEST)
    return directions * np.minimum(deviations, widest[:, np.newaxis])[:, np.newaxis]


def _covariance(
    y: Float[np.ndarray, "n p k"], weights: Float[np.ndarray, " p"]
) -> Float[np.ndarray, "n k k"]:
    """Second moments about y at the mean, which comes first."""
    root = np.sqrt(weights)[:, np.newaxis] * (y - y[:, :1])
    return np.swapaxes(root, 1, 2) @ root


@cache
def _cubature() -> tuple[Float[np.ndarray, "p 5"], Float[np.ndarray, " p"]]:
    """Points of a standard normal distribution, the mean first, and their weights."""
    n = DIMENSION
    axes, corners = np.sqrt((n + 2) / 2) * np.eye(n), np.array(list(product((1.0, -1.0), repeat=n)))
    points = np.concatenate([np.zeros((1, n)), axes, -axes, np.sqrt((n + 2) / (n - 2)) * corners])
    corner = ((n - 2) / (n + 2)) ** 2 / len(corners)
    return points, np.concatenate([[0.0], np.full(2 * n, 4 / (n + 2) ** 2), np.full(len(corners), corner)])


def axis_turns(
    axes: Float[np.ndarray, "n 3 3"], vectors: Float[np.ndarray, "n p 3 3"]
) -> Float[np.ndarray, "n p 3"]:
    """The shortest rotation vectors, in axes b, from the axes to eigenvectors of whatever signs."""
    vectors = vectors * np.sign(np.linalg.det(vectors))[..., np.newaxis, np.newaxis]
    turned = np.swapaxes(axes, 1, 2)[:, np.newaxis] @ vectors
    traces = np.einsum("npkk,jk->npj", turned, TURNS)
    chosen = TURNS[np.argmax(traces, axis=2)]
    return rotation_vector_from_matrix(turned * chosen[:, :, np.newaxis])


@cache
@building()
def _moved_inertia() -> Compiled:
    """J (9 x 1) at s [+] d."""
    s, d = ca.SX.sym("s", DIMENSION), ca.SX.sym("d", DIMENSION)
    moved = ca.vec(inertia(retract_mass(s, d)))
    return Compiled.late(ca.Function("moved_inertia", [s, d], [moved], ["s", "d"], ["J"]))


REACH: Final[float] = 4.0
"""Standard deviations of the mass distribution at which the interval ends: those that ``ok`` speaks of."""
STEPS: Final[int] = 3
"""Of a search along the gradient."""
FRACTIONS: Final = np.array([0.5, 0.75, 1.0])
"""Of a direction that are looked at, all clear of `NEAREST`: a ratio that is bounded by one is nearest to it inside."""
NEAREST: Final[float] = 1.0
"""Deviations from which on a departure is taken over its distance."""
UPPER, LOWER = [0, 1, 0], [2, 2, 1]
"""Moments (ascending) of the log ratios y: numerator and denominator."""
AFTER, LAST = [1, 2, 0], [2, 0, 1]
"""Axes that a turn about each axis takes into each other."""
SIGNS, SOUGHT = np.repeat([1.0, -1.0], 6), np.tile(np.arange(6), 2)
"""Of the twelve searches: largest (1) or smallest (-1), and of which y."""
SMALLEST_MOMENTS: Final = np.array([0.0, 0.5])
"""That the smallest and the middle moment of any body have, over the largest."""
LARGEST_LOG: Final = 30.0
"""Of second moments of determinant one, beyond which they differ by more than numbers resolve."""
ROUND: Final = np.concatenate([np.zeros((1, 3)), 3.0 - 9.0 * np.eye(3)])
"""Logarithms of second moments, determinant one, of a sphere and of discs about three axes, whose largest moment is the sum of the
others to 1e-4."""
SMALLEST_GAP: Final = 1e-12
"""Of second moments, relative to the largest: below it rounding decides."""
DIRECTIONS: Final = np.concatenate([np.eye(DIMENSION), -np.eye(DIMENSION)])
"""That searches begin from, of the one that lies farthest out."""
Departures = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 3"]]
"""Of the moments (largest = 1), of their log ratios k1, k2, and of the axes about themselves, rad."""


@cache
def sphere_reach() -> float:
    """R5: length of the errors of all five directions that is as improbable as `REACH` in one."""
    from scipy.special import chdtrc, chdtri  # here alone: many commands need none of it

    return float(np.sqrt(chdtri(DIMENSION, chdtrc(1, REACH**2))))


def widest_departures(
    s: Float[np.ndarray, "n 5"], factor: Float[np.ndarray, "n 5 e"], axes: Float[np.ndarray, "n 3 3"]
) -> Departures:
    """Deviations of which no error within `REACH` of the mass distribution's is more than it is of those.

    Parameters
    ----------
    s : Float[np.ndarray, 'n 5']
        Mass distributions, whose error has the covariance factor factor'.
    axes : Float[np.ndarray, 'n 3 3']
        Columns.

    Returns
    -------
    Not a number where s is beyond `LARGEST_LOG`, a body only to rounding.
    """
    L = _lower_factors(s)
    lengths = np.linalg.svd(np.nan_to_num(L), compute_uv=False)
    absurd = ~(2 * np.abs(np.log(lengths)).max(axis=1) < LARGEST_LOG)
    L = np.where(absurd[:, np.newaxis, np.newaxis], np.eye(3), L)
    errors, library = _round_errors(L), _library()
    bodies = _Bodies(L, principal_steps(factor, errors[:, 0]), axes)
    if library is not None:
        found = np.empty((len(s), 7))
        given = tuple(np.ascontiguousarray(each, dtype=float) for each in (L, bodies.steps, axes, errors))
        library.widest_departures(
            len(s), *map(address, given), sphere_reach(), address(FRACTIONS), address(found)
        )
        found[absurd] = np.nan
        return np.pad(found[:, :2], ((0, 0), (0, 1))), found[:, 2:4], found[:, 4:]
    y, at, distance = _extremes(bodies)
    y[absurd] = np.nan
    away, shares = np.abs(at - y[:, np.newaxis]), _shares(distance)
    moments, scaled = np.zeros((len(s), 3)), np.exp(y[:, :2])
    departure = np.max(np.abs(np.exp(at[..., :2]) - scaled[:, np.newaxis]) * shares, axis=1)
    moments[:, :2] = np.minimum(departure, np.maximum(1.0 - scaled, scaled - SMALLEST_MOMENTS) / REACH)
    ratios, turns = np.max(away[..., 1:3] * shares, axis=1), np.max(away[..., 3:], axis=1) / REACH
    return moments, ratios, turns


@dataclass(frozen=True)
class _Bodies:
    """Mass distributions: factors L of their second moments, steps F of their errors, axes as columns."""

    L: Float[np.ndarray, "n 3 3"]
    steps: Float[np.ndarray, "n 5 5"]
    axes: Float[np.ndarray, "n 3 3"]

    def at(
        self, u: Float[np.ndarray, "n p 5"]
    ) -> tuple[Float[np.ndarray, "n p 6"], Float[np.ndarray, "n p 6 5"]]:
        """y, and its gradient by u; that of a turn as seen from the axes there."""
        values, V, B = self._errors(u)
        p, vectors = _principal(B, values)
        vectors, R = _aligned(vectors, self.axes)
        w = np.swapaxes(vectors, -1, -2) @ B
        one, other = w[..., [0, 1, 2, *LAST], :], w[..., [0, 1, 2, *AFTER], :]
        inner = (
            _quotients(values)[..., np.newaxis, :, :] * one[..., :, np.newaxis] * other[..., np.newaxis, :]
        )
        V = V[..., np.newaxis, :, :]
        slopes = _by_components(V @ inner @ np.swapaxes(V, -1, -2)) @ self.steps[:, np.newaxis]
        moments = p.sum(axis=-1, keepdims=True) - p
        own, turned = slopes[..., :3, :], slopes[..., 3:, :]
        relative = (own.sum(axis=-2, keepdims=True) - own) / moments[..., np.newaxis]
        gap, floor = p[..., AFTER] - p[..., LAST], SMALLEST_GAP * p[..., :1]
        turned = turned / np.where(np.abs(gap) < floor, floor, gap)[..., np.newaxis]
        ratios, logs = relative[..., UPPER, :] - relative[..., LOWER, :], np.log(moments)
        turns = np.arctan2(R[..., LAST, AFTER], R[..., AFTER, AFTER])
        y = np.concatenate([logs[..., UPPER] - logs[..., LOWER], turns], axis=-1)
        return y, np.concatenate([ratios, turned], axis=-2)

    def values(self, u: Float[np.ndarray, "n p 5"]) -> Float[np.ndarray, "n p 6"]:
        """The perturbed quantities y.

        The turns are those of one rotation, about one axis more than its own where the others turn far.
        """
        values, _, B = self._errors(u)
        p, vectors = _principal(B, values)
        logs = np.log(p.sum(axis=-1, keepdims=True) - p)
        return np.concatenate([logs[..., UPPER] - logs[..., LOWER], axis_turns(self.axes, vectors)], axis=-1)

    def _errors(
        self, u: Float[np.ndarray, "n p 5"]
    ) -> tuple[Float[np.ndarray, "n p 3"], Float[np.ndarray, "n p 3 3"], Float[np.ndarray, "n p 3 3"]]:
        """l, V and L V."""
        values, V = np.linalg.eigh(_symmetric(u @ np.swapaxes(self.steps, 1, 2)))
        return values, V, self.L[:, np.newaxis] @ V

    def along(
        self, u: Float[np.ndarray, "n 12 5"]
    ) -> tuple[Float[np.ndarray, "n 12"], Float[np.ndarray, "n 12 5"]]:
        """Objective of each search, and its direction of ascent."""
        y, slope = self.at(u)
        each = np.arange(len(SOUGHT))
        slope = SIGNS[:, np.newaxis] * slope[:, each, SOUGHT]
        length = np.linalg.norm(slope, axis=2, keepdims=True)
        return SIGNS * y[:, each, SOUGHT], slope / np.where(length > 0, length, 1.0)


def _extremes(
    bodies: _Bodies,
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n p 6"], Float[np.ndarray, "n p"]]:
    """Each y itself, where it is small or large within reach, and how far these points are, in deviations.

    The first of the points is the sphere; a round body that is out of reach stands at the mean, with a distance of zero.
    """
    n = len(bodies.L)
    y = bodies.values(np.broadcast_to(REACH * DIRECTIONS, (n, *DIRECTIONS.shape)))
    u = _farthest(bodies, REACH * DIRECTIONS[np.concatenate([y.argmax(axis=1), y.argmin(axis=1)], axis=1)])
    inside = (FRACTIONS[:, np.newaxis, np.newaxis] * u[:, np.newaxis]).reshape(n, -1, DIMENSION)
    points = np.concatenate([_round_bodies(bodies), inside, np.zeros((n, 1, DIMENSION))], axis=1)
    found = bodies.values(points)
    return found[:, -1], found, np.linalg.norm(points, axis=2)


def _shares(distance: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n p 1"]:
    """Deviations over departures at points of these distances: 1 / r, and R5 / R / r of the sphere, which is the first.

    None of a point nearer than `NEAREST`, where a departure over its distance is the first order's, which is counted otherwise.
    """
    shares = np.where(distance >= NEAREST, 1.0 / np.maximum(distance, NEAREST), 0.0)
    shares[:, 0] *= sphere_reach() / REACH
    return shares[..., np.newaxis]


def _in_deviations(bodies: _Bodies, errors: Float[np.ndarray, "n k 5"]) -> Float[np.ndarray, "n k 5"]:
    """u of errors D; infinite along what is known exactly."""
    lengths = np.linalg.norm(bodies.steps, axis=1)[:, np.newaxis]
    along = errors @ bodies.steps  # columns are orthogonal
    return np.divide(along, lengths**2, out=np.full_like(along, np.inf), where=lengths > 0)


def _round_bodies(bodies: _Bodies) -> Float[np.ndarray, "n 4 5"]:
    """The sphere and the discs, those within their reach; others are left at the mean."""
    u = _in_deviations(bodies, _round_errors(bodies.L))
    reach = np.array([sphere_reach(), REACH, REACH, REACH])[:, np.newaxis]
    return np.where(np.linalg.norm(u, axis=2, keepdims=True) <= reach, u, 0.0)


def _round_errors(L: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 4 5"]:
    """Errors D that lead to a sphere and to discs about three axes."""
    _, lengths, transposed = np.linalg.svd(L)
    logs, V = ROUND - 2 * np.log(lengths)[:, np.newaxis], np.swapaxes(transposed, 1, 2)[:, np.newaxis]
    D = (V * logs[..., np.newaxis, :]) @ np.swapaxes(V, -1, -2)
    return np.stack([D[..., j, k] for j, k in ((0, 0), (1, 1), (1, 0), (2, 0), (2, 1))], axis=-1)


def _farthest(bodies: _Bodies, u: Float[np.ndarray, "n 12 5"]) -> Float[np.ndarray, "n 12 5"]:
    """Points on the sphere where each search ends."""
    (value, slope), share = bodies.along(u), np.ones((*u.shape[:2], 1))
    for _ in range(STEPS):
        moved = u + share * REACH * slope
        moved *= REACH / np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), np.finfo(float).tiny)
        reached, steeper = bodies.along(moved)
        better = (reached > value)[..., np.newaxis]
        u, slope = np.where(better, moved, u), np.where(better, steeper, slope)
        value, share = np.maximum(value, reached), np.where(better, share, share / 3)
    return u


def _principal(
    B: Float[np.ndarray, "n p 3 3"], values: Float[np.ndarray, "n p 3"]
) -> tuple[Float[np.ndarray, "n p 3"], Float[np.ndarray, "n p 3 3"]]:
    """Second moments and axes of B exp(diag(values)) B', by ascending moments of inertia."""
    A = B * np.exp(values / 2)[..., np.newaxis, :]
    p, vectors = np.linalg.eigh(A @ np.swapaxes(A, -1, -2))
    return np.maximum(p, np.finfo(float).eps * p[..., 2:])[..., ::-1], vectors[..., ::-1]


def _aligned(
    vectors: Float[np.ndarray, "n p 3 3"], axes: Float[np.ndarray, "n 3 3"]
) -> tuple[Float[np.ndarray, "n p 3 3"], Float[np.ndarray, "n p 3 3"]]:
    """Eigenvectors with the signs that are nearest to the axes, and their components along these."""
    R = np.swapaxes(axes, 1, 2)[:, np.newaxis] @ vectors
    signs = np.where(np.diagonal(R, axis1=-2, axis2=-1) < 0, -1.0, 1.0)[..., np.newaxis, :]
    return vectors * signs, R * signs


def _quotients(values: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Phi of eigenvalues of D."""
    half = (values[..., :, np.newaxis] - values[..., np.newaxis, :]) / 2
    quotient = np.where(half == 0, 1.0, np.sinh(half) / np.where(half == 0, 1.0, half))
    return quotient * np.exp(half + values[..., np.newaxis, :])


def _lower_factors(s: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, "n 3 3"]:
    """L(s) (`spinfilters.core.mass_distribution`)."""
    # the diagonal from the logarithms, whose sum is 0, then the entries below it row by row
    L = np.zeros((len(s), 3, 3))
    L[:, [0, 1, 2], [0, 1, 2]] = np.exp(np.stack([s[:, 0], s[:, 1], -s[:, 0] - s[:, 1]], axis=1))
    L[:, [1, 2, 2], [0, 0, 1]] = s[:, 2:]
    return L


def _symmetric(d: Float[np.ndarray, "n p 5"]) -> Float[np.ndarray, "n p 3 3"]:
    """D of its components."""
    D = np.stack([d[..., [0, 2, 3]], d[..., [2, 1, 4]], d[..., [3, 4, 0]]], axis=-2)
    D[..., 2, 2] = -d[..., 0] - d[..., 1]
    return D


def _by_components(G: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 5"]:
    """The derivative by the components of D of what has the derivative G by D."""
    # D has no trace: its last diagonal entry is minus the sum of the others; entries off the diagonal stand twice
    first, second = G[..., 0, 0] - G[..., 2, 2], G[..., 1, 1] - G[..., 2, 2]
    off = [G[..., 1, 0] + G[..., 0, 1], G[..., 2, 0] + G[..., 0, 2], G[..., 2, 1] + G[..., 1, 2]]
    return np.stack([first, second, *off], axis=-1)


@cache
def _library() -> ctypes.PyDLL | None:
    """The loops of `body_spread.c`; None without a compiler."""
    numbers = {"REACH": REACH, "NEAREST": NEAREST, "SMALLEST_GAP": SMALLEST_GAP}
    text = f"enum {{ LANES = {LANES}, STEPS = {STEPS}, SEARCHES = {len(SOUGHT)} }};\n"
    text += "".join(f"static const double {name} = {value!r};\n" for name, value in numbers.items())
    text += files("spinfilters.models").joinpath("body_spread.c").read_text()
    flags = (*KERNEL_FLAGS, "-fno-strict-aliasing", "-Wno-psabi")
    return with_signatures(
        load_text("body_spread", text, flags),
        {
            "body_spread": Signature("ipppipppppp", None),
            "widest_departures": Signature("ippppdpp", None),
        },
    )
