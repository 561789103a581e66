"""Landmark observations of many epochs as one flat list: linearised, and landmarks placed anew where too few are inliers."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.compiled import addresses
from spinfilters.core.errors import InputError
from spinfilters.core.robust_losses import RobustLoss
from spinfilters.core.vectorised import result_array
from spinfilters.filters.timeline import Timeline, by_sensor
from spinfilters.models.measurement import LandmarkSensor, MeasurementModel
from spinfilters.models.state_layout import POSE_BLOCKS
from spinfilters.smoother.kernels import kernels

ROWS = 3
"""Components of an observation's innovation, at most; a sensor with fewer leaves rows of zeros."""
COLUMNS = 10
"""Of a row: six by the pose, three by the landmark, and the innovation."""
OBSERVATIONS_NEEDED = 2
"""Of one landmark: a single observation by a stereo pair says where the landmark is and nothing else."""

SPREAD = 8
"""Times as many numbers as there are ids, that a table of ids may have: sparser ids are searched for."""

NOTHING_TWICE = "no landmark of the map is seen twice in these epochs; check the landmark ids"


@dataclass(frozen=True)
class SensorGroup:
    """Landmark observations of one sensor: indices in the flat list, values, and parameters without the point."""

    model: LandmarkSensor
    rows: Int[np.ndarray, " g"]
    values: Float[np.ndarray, "g v"]
    parameters: Float[np.ndarray, "g p"]


@dataclass(frozen=True)
class LandmarkObservations:
    """N observations, sorted by landmark, then by epoch.

    Attributes
    ----------
    epoch, landmark : ndarray of int, shape (N,)
        Number of the epoch and of the landmark.
    place : ndarray of int, shape (N,)
        Where an observation stands among all of its epoch.
    counts : ndarray of int, shape (k,)
        How many observations each epoch has.
    landmarks : int
        How many landmarks there are.
    """

    epoch: Int[np.ndarray, " N"]
    landmark: Int[np.ndarray, " N"]
    place: Int[np.ndarray, " N"]
    counts: Int[np.ndarray, " k"]
    landmarks: int
    groups: tuple[SensorGroup, ...]
    scale: float = 1.0
    """Of the standard deviations that the models state."""

    def __len__(self) -> int:
        return len(self.epoch)

    @cached_property
    def start(self) -> Int[np.ndarray, " l"]:
        """Offset of each landmark's observations, and the total."""
        count = np.bincount(self.landmark, minlength=self.landmarks)
        return np.concatenate([[0], np.cumsum(count)])

    @cached_property
    def latest(self) -> Int[np.ndarray, " q"]:
        """The observations of the last epoch."""
        return np.flatnonzero(self.epoch == len(self.counts) - 1)

    def by_epoch(self, chosen: Bool[np.ndarray, " N"]) -> tuple[Bool[np.ndarray, " _"], ...]:
        """A choice as one array per epoch, over all observations of the epoch."""
        flags = np.zeros(int(self.counts.sum()), dtype=bool)
        ends = np.cumsum(self.counts)
        flags[(ends - self.counts)[self.epoch[chosen]] + self.place[chosen]] = True
        return tuple(np.split(flags, ends[:-1]))


@dataclass(frozen=True)
class LinearObservations:
    """Observations linearised and whitened about a trajectory.

    Attributes
    ----------
    rows : ndarray of float, shape (N, 3, 10)
        See `COLUMNS`.
    square : ndarray of float, shape (N,)
        Squared length of the innovation, infinite where the sensor's model does not apply.
    """

    rows: Float[np.ndarray, "N 3 10"]
    square: Float[np.ndarray, " N"]
    _weights: list[tuple[RobustLoss, np.ndarray]] = field(
        default_factory=list, init=False, repr=False, compare=False
    )

    def weight(self, loss: RobustLoss) -> Float[np.ndarray, " N"]:
        """Weight of each observation, not to be written to; that of the last loss is kept."""
        if not self._weights or self._weights[0][0] is not loss:
            self._weights[:] = [(loss, loss.weight(self.square))]
        return self._weights[0][1]

    @property
    def innovation(self) -> Float[np.ndarray, "N 3"]:
        """Whitened innovations."""
        return self.rows[:, :, -1]

    @property
    def size(self) -> Float[np.ndarray, " N"]:
        """Length of the innovation in standard deviations."""
        return np.sqrt(self.square)

    def cost(self, loss: RobustLoss, used: Bool[np.ndarray, " N"]) -> float:
        """Cost of the inliers."""
        return float(loss.cost(self.square)[used].sum())


@dataclass(frozen=True)
class _ObservationIndex:
    """Observations as they lie in the epochs."""

    epoch: Int[np.ndarray, " s"]
    place: Int[np.ndarray, " s"]
    ids: Int[np.ndarray, " s"]
    counts: Int[np.ndarray, " k"]
    groups: tuple[SensorGroup, ...]


def collect_observations(epochs: Timeline, ids: Int[np.ndarray, " L"], needed: int) -> LandmarkObservations:
    """Observations of the landmarks of these ids (ascending) that occur at least ``needed`` times.

    Raises
    ------
    InputError
        When a sensor of landmarks sees more than the pose.
    """
    seen = _index_observations(epochs)
    landmark = places_among(ids, seen.ids)
    # keep those of landmarks that are observed often enough; the last count is that of ids that are not among these
    count = np.bincount(np.where(landmark < 0, len(ids), landmark), minlength=len(ids) + 1)
    count[-1] = 0
    kept = np.flatnonzero((count[landmark] >= needed) & (landmark >= 0))
    # by landmark, and of one landmark by epoch, as they are sorted by epoch already: the order in which elimination takes them
    order = kept[order_of_landmarks(landmark[kept], len(ids))]
    groups = tuple(_choose_group(group, order, len(landmark)) for group in seen.groups)
    return LandmarkObservations(
        seen.epoch[order],
        landmark[order],
        seen.place[order],
        seen.counts,
        len(ids),
        tuple(group for group in groups if len(group.rows)),
    )


def order_of_landmarks(landmark: Int[np.ndarray, " N"], landmarks: int) -> Int[np.ndarray, " N"]:
    """Stable order by landmark: of one landmark the observations stay as they are."""
    many = landmarks > np.iinfo(np.uint16).max  # 16 bits are sorted in linear time
    return np.argsort(landmark if many else landmark.astype(np.uint16), kind="stable")


def places_among(known: Int[np.ndarray, " L"], ids: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Index of each id among distinct known ones, or -1."""
    if not len(known) or not len(ids):
        return np.full(len(ids), -1)
    low, high = int(known.min()), int(known.max())
    if high - low < SPREAD * (len(known) + len(ids)):
        # a table over all ids from the lowest to the highest, with one more entry for those beyond
        table = np.full(high - low + 2, -1)
        table[known - low] = np.arange(len(known))
        return table.take(np.where((ids >= low) & (ids <= high), ids - low, high - low + 1))
    order = np.argsort(known, kind="stable")  # ids in runs that ascend, which a stable sort is quick with
    at = order[np.minimum(np.searchsorted(known.take(order), ids), len(order) - 1)]
    return np.where(known[at] == ids, at, -1)


def seen_ids(epochs: Timeline) -> Int[np.ndarray, " s"]:
    """Ids of all observations of some epochs, one sensor after the other."""
    found = [each.measurement.ids for each in by_sensor(epochs) if each.measurement.ids is not None]
    return np.concatenate([np.zeros(0, dtype=int), *found])


def _choose_group(group: SensorGroup, order: Int[np.ndarray, " N"], count: int) -> SensorGroup:
    """A group's part of a choice, in the order of the choice."""
    # place within the group of every observation, -1 of another group's
    inside = np.full(count, -1)
    inside[group.rows] = np.arange(len(group.rows))
    # rows: places within the choice that the group has; own: which of the group's observations stand there
    taken = inside[order]
    rows = np.flatnonzero(taken >= 0)
    own = taken[rows]
    return replace(
        group, rows=rows, values=group.values.take(own, axis=0), parameters=group.parameters.take(own, axis=0)
    )


def _index_observations(epochs: Timeline) -> _ObservationIndex:
    """Observations in the order of epochs, those of one sensor after those of another."""
    nothing = np.zeros(0, dtype=int)
    parts = [(found, ids) for found in by_sensor(epochs) if (ids := found.measurement.ids) is not None]
    every = np.concatenate([nothing, *(found.epoch for found, _ in parts)])
    # order sorts the sensors' observations, one sensor after the other, by epoch; number is its inverse
    order = np.argsort(every, kind="stable")
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    ids = np.concatenate([nothing, *(own for _, own in parts)])
    counts = np.bincount(every, minlength=len(epochs))
    epoch = every[order]
    # place of an observation within its epoch: its number less those of all epochs before
    place = np.arange(len(order)) - (np.cumsum(counts) - counts)[epoch]
    # numbers of a sensor's observations: its part of the concatenation above
    ends = np.cumsum([len(own) for _, own in parts])
    groups = tuple(
        SensorGroup(
            _sensor_of_poses(m.model), number[end - len(m.values) : end], m.values, m.parameters[:, 3:]
        )
        for m, end in zip((found.measurement for found, _ in parts), ends, strict=True)
    )
    return _ObservationIndex(epoch, place, ids[order], counts, groups)


def _sensor_of_poses(model: MeasurementModel) -> LandmarkSensor:
    """A landmark sensor that a smoother takes."""
    sensor = model.landmark_sensor
    if sensor is None or sensor.needs != POSE_BLOCKS or sensor.dim > ROWS:
        raise InputError(
            f"sensor {model.name} sees {model.needs}; a smoother takes a LandmarkSensor of (t, a) with at most "
            f"{ROWS} components"
        )
    return sensor


def linearise_observations(
    observations: LandmarkObservations, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> LinearObservations:
    """All observations about a trajectory and points (m, frame g)."""
    # one sensor of three components fills all rows; else each fills its own, and rows that it lacks stay zero
    whole = len(observations.groups) == 1 and observations.groups[0].model.dim == ROWS
    if whole and (made := _linearised_in_c(observations, trajectory, points)) is not None:
        return made
    rows = np.empty((0, ROWS, COLUMNS)) if whole else np.zeros((len(observations), ROWS, COLUMNS))
    square = np.full(len(observations), np.inf)
    for group in observations.groups:
        every = slice(None) if whole else group.rows
        epoch, landmark = observations.epoch[every], observations.landmark[every]
        made, positive, length, _ = group.model.observation_rows(
            trajectory, points, group.parameters, group.values, rows=(epoch, landmark, None, None)
        )
        made = made.reshape(len(made), group.model.dim, COLUMNS)
        if whole:
            rows = made
        else:
            rows[every, : group.model.dim] = made
        good = (positive[:, 0] > 0) & np.isfinite(length[:, 0])
        square[every] = np.where(good, length[:, 0], np.inf)
    if observations.scale != 1.0:
        rows, square = rows / observations.scale, square / observations.scale**2
    return LinearObservations(rows, square)


def _linearised_in_c(
    s: LandmarkObservations, trajectory: Float[np.ndarray, "k m"], points: Float[np.ndarray, "L 3"]
) -> LinearObservations | None:
    """Observations of one sensor of three components in one call; None without compiled code."""
    library, (group,), count = kernels(), s.groups, len(s)
    lanes = None if library is None else group.model.quick_observation_rows.loop
    if library is None or lanes is None:
        return None
    given = trajectory, points, group.parameters, group.values, s.epoch, s.landmark
    arrays = [np.ascontiguousarray(array) for array in given]
    rows, square, room = result_array(count, ROWS * COLUMNS), np.empty(count), np.empty((2, count))
    library.linearise_observations(
        *(lanes, count, *addresses(*arrays)),
        *(trajectory.shape[1], group.parameters.shape[1], group.values.shape[1], s.scale),
        *addresses(rows, square, room),
    )
    return LinearObservations(rows.reshape(count, ROWS, COLUMNS), square)


def reinitialised(
    observations: LandmarkObservations,
    trajectory: Float[np.ndarray, "k m"],
    points: Float[np.ndarray, "L 3"],
    inliers: Bool[np.ndarray, " N"],
    gate: float,
) -> Float[np.ndarray, "L 3"] | None:
    """Landmark points (m, frame g) with those of fewer than two inliers re-initialised; None where none can be.

    Parameters
    ----------
    gate : float
        Mahalanobis distance within which two observations' own points agree.
    """
    rows = _find_lost(observations, inliers)
    if not len(rows):
        return None
    rows, own, covariance_sqrt = _own_points(observations, trajectory, rows)
    rows, own, covariance_sqrt = _by_landmark(observations.landmark, rows, own, covariance_sqrt)
    if not len(rows):
        return None
    covariance = covariance_sqrt @ np.swapaxes(covariance_sqrt, 1, 2)
    landmark = observations.landmark[rows]
    # Each pair of observations of a landmark whose own points agree gives both a vote.
    one, other = _pairs(landmark)
    agree = _distance(own, covariance, one, other) < gate
    one, other = _both_ways(one[agree], other[agree], len(rows))
    votes = np.bincount(one, minlength=len(rows))
    # The observation with most votes of each landmark, if it agrees with at least one other.
    order = np.lexsort((votes, landmark))
    winners = order[np.flatnonzero(np.diff(landmark[order], append=-1))]
    winners = winners[votes[winners] >= OBSERVATIONS_NEEDED]
    if not len(winners):
        return None
    # The landmark moves to the mean of the winner's point and those that agree with it.
    kept = np.isin(one, winners)
    moved = points.copy()
    moved[landmark[winners]] = _means(one[kept], other[kept], own, covariance)[winners]
    return moved


def _find_lost(observations: LandmarkObservations, inliers: Bool[np.ndarray, " N"]) -> Int[np.ndarray, " r"]:
    """Observations of landmarks with fewer than two inliers, and with two observations that may agree."""
    every = np.diff(observations.start)
    hits = np.bincount(observations.landmark[inliers], minlength=len(every))
    lost = (hits < OBSERVATIONS_NEEDED) & (every >= OBSERVATIONS_NEEDED)
    return np.flatnonzero(lost[observations.landmark])


def _own_points(
    observations: LandmarkObservations, trajectory: Float[np.ndarray, "k m"], rows: Int[np.ndarray, " r"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows that determine a point by themselves, with points and covariance square roots."""
    found, points, covariance_sqrts = [np.zeros(0, dtype=int)], [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
    for group in observations.groups:
        at = np.flatnonzero(np.isin(group.rows, rows))
        if not len(at):
            continue
        of = group.rows[at]
        parameters = np.concatenate([np.zeros((len(at), 3)), group.parameters[at]], axis=1)
        new = group.model.new_landmarks(trajectory[observations.epoch[of]], parameters, group.values[at])
        good = new.determined & np.isfinite(new.points).all(axis=1)
        found.append(of[good])
        points.append(new.points[good])
        covariance_sqrts.append(new.root[good])
    return np.concatenate(found), np.concatenate(points), np.concatenate(covariance_sqrts)


def _by_landmark(
    landmark: Int[np.ndarray, " N"], rows: Int[np.ndarray, " r"], *each: np.ndarray
) -> tuple[np.ndarray, ...]:
    order = np.argsort(landmark[rows], kind="stable")
    return rows[order], *(values[order] for values in each)


def _pairs(landmark: Int[np.ndarray, " r"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Every pair of two rows of one landmark, the earlier first; landmarks ascend."""
    row = np.arange(len(landmark))
    # rows after each one that are of its landmark: the next landmark begins where searchsorted says
    count = np.searchsorted(landmark, landmark, side="right") - row - 1
    # each row as often as it has partners, and the number of the partner, 0 for the next row
    one = np.repeat(row, count)
    within = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    return one, one + 1 + within


def _both_ways(
    one: Int[np.ndarray, " p"], other: Int[np.ndarray, " p"], rows: int
) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, " q"]]:
    """Ordered pairs, each row with itself among them."""
    itself = np.arange(rows)
    return np.concatenate([one, other, itself]), np.concatenate([other, one, itself])


def _distance(
    points: Float[np.ndarray, "r 3"],
    covariance: Float[np.ndarray, "r 3 3"],
    one: np.ndarray,
    other: np.ndarray,
) -> Float[np.ndarray, " p"]:
    """Mahalanobis distance of two points, by the adjugate of their covariances' sum."""
    x, y, z = (points[one] - points[other]).T
    spread = covariance[one] + covariance[other]
    # S = [a d e; d b f; e f c]; first to third are the cofactors of its first row
    a, b, c = spread[:, 0, 0], spread[:, 1, 1], spread[:, 2, 2]
    d, e, f = spread[:, 1, 0], spread[:, 2, 0], spread[:, 2, 1]
    first, second, third = b * c - f * f, e * f - d * c, d * f - e * b
    # v' adj(S) v, then over det S = a first + d second + e third
    square = first * x * x + (a * c - e * e) * y * y + (a * b - d * d) * z * z
    square += 2 * (second * x * y + third * x * z + (d * e - a * f) * y * z)
    return np.sqrt(np.maximum(square, 0.0) / (a * first + d * second + e * third))


def _means(
    one: Int[np.ndarray, " p"],
    other: Int[np.ndarray, " p"],
    points: Float[np.ndarray, "r 3"],
    covariance: Float[np.ndarray, "r 3 3"],
) -> Float[np.ndarray, "r 3"]:
    """For every row named in ``one`` the information-weighted mean of the points of ``other``."""
    # sums over each row's partners of the information C^-1 and of C^-1 p, then their quotient
    each = np.linalg.inv(covariance[other])
    information, weighted = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    np.add.at(information, one, each)
    np.add.at(weighted, one, (each @ points[other][..., None])[..., 0])
    result = np.full((len(points), 3), np.nan)
    named = np.unique(one)
    result[named] = np.linalg.solve(information[named], weighted[named][..., None])[..., 0]
    return result
