"""Draws of simulation-based calibration: truth and measurements from a stated prior, and what an estimator states of the truth.

The rank of the truth in a posterior that is right is uniform (Talts et al. 2018), if the truth is drawn from the prior that the
estimator uses. Each draw takes body, motion and noise from the prior below, states that of the body, and simulates the recording.
It keeps the error, the stated deviation, the rank of the truth and scores of every component of moments, axes, rate and centre of
mass. Ranks and scores are those of the stated mixture where a deviation covers several explanations of the measurements
(`EstimateHistory.mixture`), and of a Gaussian elsewhere.

The folder of a calibration holds the study that its draws belong to, and the draws as lines of JSON. A line holds one draw with all
estimators, and is written as soon as the draw is made. Lines that hold none (a kill has cut them short, a bit has flipped) are
never read, and their draws are made again. Where a seed stands twice, its last line counts.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri, ndtr

from spinfilters.core.attitude_conversions import euler321_from_quaternion, quaternion_from_matrix
from spinfilters.core.errors import NUMERICAL_ERRORS, InputError
from spinfilters.evaluation.consistency import knows_state, true_states
from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.evaluation.recording_bound import without_bounds
from spinfilters.evaluation.stated_errors import LARGEST_STATED_ERROR, stated_errors
from spinfilters.evaluation.trajectory_errors import common_stamps
from spinfilters.filters.history import EstimateHistory, history_at
from spinfilters.filters.square_root import lower_roots
from spinfilters.io.input_file import path_text, read_bytes, read_settings_text, reason, value_text
from spinfilters.io.output_files import write_json
from spinfilters.models.body import body_estimate, turn_of_axes
from spinfilters.models.process import ProcessNoise
from spinfilters.models.status import AXES, CENTRE, MOMENTS, RATE, Verdict
from spinfilters.run.estimation import ComparisonExtent, compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import InitialisationOptions, Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_noise
from spinfilters.verdict.checks import LARGEST_MOMENT_STD

LOG_MOMENT_STD: Final = 0.3
"""Of the logarithms of the second moments of `drawn_scenario`, whose mean is removed: 0.5 : 0.8 : 1 to 1 : 1 : 1 are likely."""
RATE_RPM: Final = (3.0, 12.0)
"""Least and largest rate of rotation, log-uniform; its direction is uniform."""
LEVELS: Final = {
    "gyro": {"gyro_std": (2e-4, 2e-2)},
    "attitude": {"attitude_std": (2e-3, 3e-2)},
    "pose": {"position_std": (1e-3, 2e-2), "rotation_std": (2e-3, 3e-2)},
    "lidar-points": {"lidar_range_std": (3e-3, 3e-2), "lidar_angle_std": (1e-4, 1e-3)},
    "stereo-tracks": {"pixel_std": (0.3, 2.0)},
}
"""Least and largest standard deviation of each sensor's noise, log-uniform, by field of a scenario or by noise option."""
PSD: Final = (1e-7, 1e-5)
"""Least and largest density of the disturbing torque, (rad/s^2)^2/Hz, and of the force, (m/s^2)^2/Hz; log-uniform."""
CENTRE_STD: Final = 0.02
"""Of each coordinate of the centre of mass in g, m."""
MASS_STD: Final = 0.3
"""Of the five numbers of the mass distribution about the sphere. It is stated to the estimators (``initialisation.mass_std``)."""
EPOCHS: Final = 100


@dataclass(frozen=True)
class CalibrationDraw:
    """What one estimator stated of one draw.

    Attributes
    ----------
    seed : int
        Of the draw.
    estimator : str
        Whose.
    verdict : str
        "ok", "degraded" or "failed".
    determined : bool
        Whether the stated deviations of the moments are at most a tenth of the largest.
    worst : float
        Largest error of a published quantity at the end, in stated deviations.
    quantities : dict
        By quantity a list of error, stated deviation and rank of the truth for each component.
    nees : dict
        NEES per degree of freedom of rate and mass distribution after the last epoch.
    scores : dict
        By quantity the CRPS and the negative log density of each component, by what is stated.
    mixture_nees : dict
        As ``nees`` by what is stated: of a mixture the chi-square number that is as improbable as a density as small.
    """

    seed: int
    estimator: str
    verdict: str
    determined: bool
    worst: float
    quantities: dict[str, list[tuple[float, float, float]]]
    nees: dict[str, float]
    scores: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    mixture_nees: dict[str, float] = field(default_factory=dict)

    @property
    def is_ok(self) -> bool:
        """Whether its verdict is ok."""
        return self.verdict == str(Verdict.OK)

    @property
    def is_right(self) -> bool:
        """Whether every published quantity is within `LARGEST_STATED_ERROR` deviations."""
        return self.worst <= LARGEST_STATED_ERROR


def drawn_scenario(sensor: str, seed: int) -> Scenario:
    """Body, motion and noise from the prior of a sensor.

    Raises
    ------
    InputError
        A sensor without a prior.
    """
    if sensor not in LEVELS:
        raise InputError(f"no prior is stated for the sensor {sensor}; choose from {', '.join(LEVELS)}")
    generator = np.random.default_rng([20261126, seed])

    def level(ends: tuple[float, float]) -> float:
        """Log-uniform between two numbers."""
        return float(np.exp(generator.uniform(*np.log(ends))))

    d = LOG_MOMENT_STD * generator.standard_normal(3)
    second = np.exp(d - d.mean())
    direction = generator.standard_normal(3)
    rates = level(RATE_RPM) * direction / np.linalg.norm(direction)
    x, y, z = (second.sum() - second).tolist()
    noise = {name: level(ends) for name, ends in LEVELS[sensor].items()}
    own = {each.name for each in fields(Scenario)}
    yaw, pitch, roll = generator.uniform(-1.0, 1.0, 3).tolist()
    u, v, w = rates.tolist()
    a, b, c = (CENTRE_STD * generator.standard_normal(3)).tolist()
    scenario = Scenario(
        kind=sensor,
        principal_moments=(x, y, z),
        rate_rpm=(u, v, w),
        axes_euler_g=(yaw, pitch, roll),
        center_of_mass_g=(a, b, c),
        epochs=EPOCHS,
        noise=ProcessNoise(force_psd=level(PSD), torque_psd=level(PSD)),
        seed=seed,
    )
    options = tuple((name, std) for name, std in noise.items() if name not in own)
    return replace(
        scenario, sensor_noise=options, **{name: std for name, std in noise.items() if name in own}
    )


def scenario_of_prior(sensor: str, seed: int) -> Scenario:
    """As `drawn_scenario`, with a body from the prior of `spinfilters.core.mass_distribution`, of deviation `MASS_STD`.

    Where the motion does not determine the moments, a posterior is its prior. Ranks are uniform if truths come from the same.

    Raises
    ------
    InputError
        A sensor without a prior.
    """
    d = MASS_STD * np.random.default_rng([20261127, seed]).standard_normal(5)
    # D = log S is symmetric and traceless, and d = (D_11, D_22, D_21, D_31, D_32)
    D = np.array([[d[0], d[2], d[3]], [d[2], d[1], d[4]], [d[3], d[4], -d[0] - d[1]]])
    values, axes = np.linalg.eigh(D)
    axes[:, 2] *= np.linalg.det(axes)  # a rotation
    second = np.exp(values)
    x, y, z = (second.sum() - second).tolist()
    yaw, pitch, roll = euler321_from_quaternion(quaternion_from_matrix(axes)).tolist()
    return replace(drawn_scenario(sensor, seed), principal_moments=(x, y, z), axes_euler_g=(yaw, pitch, roll))


def made_draws(sensor: str, seed: int, estimators: Sequence[str], stated: bool) -> list[CalibrationDraw]:
    """One draw, by every estimator; empty where the recording cannot be initialised.

    Parameters
    ----------
    stated : bool
        Whether the data set states its noise; if not, it is identified.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C was pressed: a draw that lacks epochs or estimators is none.
    """
    data = simulate(scenario_of_prior(sensor, seed))
    settings = Settings(estimators=tuple(estimators), initialisation=InitialisationOptions(mass_std=MASS_STD))
    try:
        setup = prepare(data if stated else without_noise(data), settings)
        comparison = compare_estimators(
            setup, settings, lambda name, done, every: None, extent=ComparisonExtent(bounding=without_bounds)
        )
    except (InputError, *NUMERICAL_ERRORS):
        return []
    if comparison.interrupted:
        raise KeyboardInterrupt
    return [calibration_draw(each, seed) for each in comparison.evaluations]


def calibration_draw(evaluation: Evaluation, seed: int) -> CalibrationDraw:
    """What an evaluation with a truth says of a draw."""
    status, stated = evaluation.history.status, stated_components(evaluation)
    found = {name: [each.triple for each in components] for name, components in stated.items()}
    moments = found.get(MOMENTS, [])
    return CalibrationDraw(
        seed,
        evaluation.name,
        str(status.verdict),
        bool(moments) and max(std for _, std, _ in moments[:2]) <= LARGEST_MOMENT_STD,
        max(stated_errors(evaluation).values(), default=float("inf")),
        found,
        _last_nees(evaluation),
        {name: [each.scores for each in components] for name, components in stated.items()},
        _mixture_nees(evaluation, seed),
    )


@dataclass(frozen=True)
class StatedComponent:
    """Error of one component, and what is stated of it.

    Attributes
    ----------
    error, std : float
        Estimate minus truth, and its stated deviation.
    weights, deviations : (c,) float arrays
        Of Gaussians about zero that describe the error.
    sampled_rank : float or None
        Rank of the truth among samples of the posterior; None without any.
    """

    error: float
    std: float
    weights: Float[np.ndarray, " c"]
    deviations: Float[np.ndarray, " c"]
    sampled_rank: float | None = None

    @property
    def triple(self) -> tuple[float, float, float]:
        """Error, deviation and rank."""
        with np.errstate(all="ignore"):
            rank = float(self.weights @ ndtr(-self.error / self.deviations))
        return self.error, self.std, rank if self.sampled_rank is None else self.sampled_rank

    @property
    def scores(self) -> tuple[float, float]:
        """CRPS, E |x - error| - E |x - x'| / 2, and negative log density."""
        s, w = self.deviations, self.weights
        with np.errstate(all="ignore"):
            z = self.error / s
            density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
            away = self.error * (2 * ndtr(z) - 1) + 2 * s * density
            apart = np.hypot(s[:, np.newaxis], s) * np.sqrt(2 / np.pi)
            return float(w @ away - 0.5 * w @ apart @ w), float(-np.log(w @ (density / s)))


def stated_components(evaluation: Evaluation) -> dict[str, list[StatedComponent]]:
    """Every component after the last epoch, by quantity."""
    truth, history, body = evaluation.truth_in_own_frames, evaluation.history, evaluation.body
    layout = history.layout
    if truth is None or not knows_state(truth, layout) or not np.isfinite(history.factor[-1]).all():
        return {}
    _, rows = common_stamps(history.time[-1:], truth.time)
    state = true_states(truth, layout)[rows[0]]
    error = -layout.local(history.mean[-1], state)
    weights, each = _stated_deviations(history)
    found = {RATE: _components(error[layout.slice("w")], weights, each[RATE])}
    if layout.translates:
        found[CENTRE] = _components(error[layout.slice("c")], weights, each[CENTRE])
    assert truth.principal_moments is not None
    assert truth.principal_axes_g is not None
    order = np.argsort(truth.principal_moments)
    true = truth.principal_moments[order] / truth.principal_moments.max()
    ratios = np.log([true[2] / true[1], true[1] / true[0]])
    away = np.array([*(body.principal_moments - true)[:2], body.k1 - ratios[0], body.k2 - ratios[1]])
    if history.mass is None:
        found[MOMENTS] = _components(away, weights, each[MOMENTS])
    else:  # a posterior that was sampled gives ranks of its own
        found[MOMENTS] = _components(away, np.ones(1), np.tile(body.shape_std, (2, 1)))
        for k in range(2):
            below = float(history.mass.weights @ (history.mass.principal_moments[:, k] < true[k]))
            found[MOMENTS][k] = replace(found[MOMENTS][k], sampled_rank=below)
    turn = turn_of_axes(body.principal_axes_g, truth.principal_axes_g[order])
    if history.mass is None:
        found[AXES] = _components(turn, weights, each[AXES])
    else:
        found[AXES] = _components(turn, np.ones(1), np.tile(body.principal_axes_std, (2, 1)))
        beyond = history.mass.weights @ (history.mass.turns(body.principal_axes_g) > turn)
        for k, rank in enumerate(
            beyond.tolist()
        ):  # a turn is truth minus estimate, so that its rank is from above
            found[AXES][k] = replace(found[AXES][k], sampled_rank=rank)
    return found


def _stated_deviations(
    history: EstimateHistory,
) -> tuple[Float[np.ndarray, " c"], dict[str, Float[np.ndarray, "d q"]]]:
    """Weights of the stated Gaussians of the last error, and deviations by quantity: those stated, then of each Gaussian."""
    last, mixture = history_at(history, np.array([-1])), history.mixture
    factors = [history.factor[-1]] * 2 if mixture is None else [history.factor[-1], *mixture.factors]
    found: dict[str, list[np.ndarray]] = {name: [] for name in (RATE, CENTRE, MOMENTS, AXES)}
    for factor in factors:
        body = body_estimate(replace(last, factor=factor[np.newaxis]).belief(0))
        std = np.linalg.norm(factor, axis=1)
        found[RATE].append(std[history.layout.slice("w")])
        if history.layout.translates:
            found[CENTRE].append(std[history.layout.slice("c")])
        found[MOMENTS].append(body.shape_std)
        found[AXES].append(body.principal_axes_std)
    weights = np.ones(1) if mixture is None else mixture.weights
    return weights, {name: np.array(own) for name, own in found.items()}


def _components(
    error: Float[np.ndarray, " q"], weights: Float[np.ndarray, " c"], deviations: Float[np.ndarray, "d q"]
) -> list[StatedComponent]:
    """Components of a quantity: the first row of deviations is stated, the others are of the Gaussians."""
    std, own = deviations[0], np.where(deviations[1:] > 0, deviations[1:], np.nan)
    return [StatedComponent(float(away), float(std[k]), weights, own[:, k]) for k, away in enumerate(error)]


DIMENSIONS: Final = {"w": 3, "s": 5, "c": 3}
"""Of the blocks whose NEES is kept."""
MIXTURE_SAMPLES: Final = 4000
"""Of a mixture, for the probability of a density as small."""


def _last_nees(evaluation: Evaluation) -> dict[str, float]:
    found = evaluation.nees or evaluation.rotation_nees
    if found is None:
        return {}
    return {
        name: float(found.blocks[name][-1]) / count
        for name, count in DIMENSIONS.items()
        if name in found.blocks
    }


def _mixture_nees(evaluation: Evaluation, seed: int) -> dict[str, float]:
    history, truth = evaluation.history, evaluation.truth_in_own_frames
    stated, mixture, layout = _last_nees(evaluation), history.mixture, history.layout
    if mixture is None or truth is None:
        return stated
    _, rows = common_stamps(history.time[-1:], truth.time)
    error = layout.local(history.mean[-1], true_states(truth, layout)[rows[0]])
    return {
        name: mixture_square(
            error[layout.slice(name)],
            mixture.weights,
            mixture.factors[:, layout.slice(name)],
            np.random.default_rng([seed, DIMENSIONS[name]]),
        )
        / DIMENSIONS[name]
        for name in stated
    }


def mixture_square(
    error: Float[np.ndarray, " d"],
    weights: Float[np.ndarray, " c"],
    factors: Float[np.ndarray, "c d e"],
    generator: np.random.Generator,
) -> float:
    """The chi-square number that is as improbable as a density of the mixture as small as that of an error.

    Of one Gaussian it is the NEES. The probability is counted over samples. Factors are rows of those of an `ErrorMixture`.
    """
    chosen = generator.choice(len(weights), MIXTURE_SAMPLES, p=weights)
    z = generator.standard_normal((MIXTURE_SAMPLES, factors.shape[2]))
    every = np.concatenate([error[np.newaxis], np.einsum("nij,nj->ni", factors[chosen], z)])
    parts = []
    for weight, root in zip(weights, lower_roots(factors), strict=True):
        squares = np.square(np.linalg.solve(root, every.T)).sum(axis=0)
        parts.append(np.log(weight) - np.linalg.slogdet(root)[1] - 0.5 * squares)
    logs = np.logaddexp.reduce(parts, axis=0)
    beyond = (np.count_nonzero(logs[1:] <= logs[0]) + 0.5) / (MIXTURE_SAMPLES + 1)
    return float(chdtri(len(error), beyond))


STUDY_FILE: Final = "calibration-study.json"
DRAWS_FILE: Final = "draws.jsonl"
LARGEST_FILE: Final = 1 << 30
"""Bytes of draws that are read: a hundred thousand draws of two estimators are a third of it."""
COMPONENT_COUNTS: Final = {MOMENTS: 4, AXES: 3, RATE: 3, CENTRE: 3}
ADDED_LATER: Final = frozenset({"scores", "mixture_nees"})
"""Entries of a draw that lines of earlier versions lack."""
_ORIGIN: Final = ("sensor", "noise")
"""Keys of a line that say what its draw is of; lines of earlier versions lack them."""


@dataclass(frozen=True)
class CalibrationStudy:
    """What the draws of a folder are of.

    Attributes
    ----------
    sensor : str
        Kind of recording.
    estimators : tuple of str
        Names.
    noise : str
        "stated" or "identified".
    """

    sensor: str
    estimators: tuple[str, ...]
    noise: str

    def document(self) -> dict[str, Any]:
        """As it is written."""
        return {**asdict(self), "estimators": list(self.estimators)}


def claim_folder(folder: Path, study: CalibrationStudy) -> None:
    """Write what a folder's draws are of.

    Raises
    ------
    InputError
        It holds draws of another study, or its study cannot be read.
    """
    path, drawn, wanted = folder / STUDY_FILE, folder / DRAWS_FILE, study.document()
    is_stated = path.exists()
    lines = list(_whole_lines(folder))
    if is_stated and lines and _stated_study(path) != wanted:
        raise InputError(f"{path_text(path)}: holds draws of another study; choose another folder (-o)")
    for number, line in lines:
        origin = {key: line[key] for key in _ORIGIN if key in line}
        if any(origin[key] != wanted[key] for key in origin):
            raise InputError(
                f"{path_text(drawn)}: line {number} holds a draw of {value_text(', noise '.join(map(str, origin.values())))}; "
                "choose another folder (-o)"
            )
        if not is_stated and len(origin) < len(_ORIGIN):
            raise InputError(
                f"{path_text(drawn)}: line {number} does not say of what sensor it is, and {STUDY_FILE} is missing; "
                "choose another folder (-o)"
            )
    write_json(path, wanted)


def _stated_study(path: Path) -> Any:
    try:
        return json.loads(read_settings_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path_text(path)}: is no JSON ({reason(error)}); remove this file and run the command again"
        ) from None


def read_draws(folder: Path, study: CalibrationStudy) -> dict[int, list[CalibrationDraw]]:
    """Draws of a folder by seed, in order of seeds; those that lack an estimator of the study are left out.

    A recording that could not be initialised has an empty list.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    found = {line["seed"]: [_draw(each) for each in line["draws"]] for _, line in _whole_lines(folder)}
    asked = set(study.estimators)
    return {
        seed: draws
        for seed, draws in sorted(found.items())
        if not draws or asked <= {draw.estimator for draw in draws}
    }


def add_draw(folder: Path, study: CalibrationStudy, seed: int, draws: Sequence[CalibrationDraw]) -> None:
    """Write a draw, by all estimators, as one line after the others.

    Raises
    ------
    OSError
        It cannot be written; what was written before stays.
    """
    wanted = study.document()
    document = {"seed": seed} | {key: wanted[key] for key in _ORIGIN} | {"draws": [asdict(d) for d in draws]}
    with (folder / DRAWS_FILE).open("a+b") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read() != b"\n":
                file.write(b"\n")  # a line that was cut off stays, and is never read
        file.write(json.dumps(document).encode() + b"\n")


def _whole_lines(folder: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Lines that hold a draw, with their numbers from 1."""
    path = folder / DRAWS_FILE
    if not path.exists():
        return
    for number, text in enumerate(read_bytes(path, LARGEST_FILE, may_be_empty=True).split(b"\n"), 1):
        try:
            line = json.loads(text)
        except (ValueError, RecursionError):
            continue
        if _holds_draw(line):
            yield number, line


def _holds_draw(line: Any) -> bool:
    if not isinstance(line, dict) or type(seed := line.get("seed")) is not int or seed < 0:
        return False
    draws = line.get("draws")
    return isinstance(draws, list) and all(_is_draw(each) and each["seed"] == seed for each in draws)


def _is_draw(document: Any) -> bool:
    """Whether it has the entries of a draw, each of its type, and of each quantity all components."""
    names = {each.name for each in fields(CalibrationDraw)}
    if not isinstance(document, dict) or not names - ADDED_LATER <= set(document) <= names:
        return False
    quantities, nees, scores = document["quantities"], document["nees"], document.get("scores", {})
    by_mixture = document.get("mixture_nees", {})
    return (
        isinstance(document["estimator"], str)
        and document["verdict"] in list(Verdict)
        and isinstance(document["determined"], bool)
        and _are_numbers([document["worst"]], 1)
        and isinstance(quantities, dict)
        and all(_are_components(quantities[name], COMPONENT_COUNTS.get(name), 3) for name in quantities)
        and isinstance(scores, dict)
        and set(scores) <= set(quantities)
        and all(_are_components(scores[name], COMPONENT_COUNTS.get(name), 2) for name in scores)
        and all(isinstance(each, dict) for each in (nees, by_mixture))
        and all(_are_numbers(list(each.values()), len(each)) for each in (nees, by_mixture))
    )


def _are_components(value: Any, count: int | None, size: int) -> bool:
    """Whether it has so many components, each of so many numbers."""
    return isinstance(value, list) and len(value) == count and all(_are_numbers(each, size) for each in value)


def _are_numbers(value: Any, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(isinstance(each, float) or (type(each) is int and abs(each) <= 2**53) for each in value)
    )


def _draw(document: dict[str, Any]) -> CalibrationDraw:
    quantities = {
        name: [(error, std, rank) for error, std, rank in components]
        for name, components in document["quantities"].items()
    }
    scores = {
        name: [(crps, log_score) for crps, log_score in components]
        for name, components in document.get("scores", {}).items()
    }
    return CalibrationDraw(**{**document, "quantities": quantities, "scores": scores})
