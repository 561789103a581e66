"""A truth that does not belong together is told; noise, rare rows and gaps are no contradiction."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.attitude_conversions import inverse, multiply, quaternion_from_rotation_vector, rotate
from spinfilters.io.truth import Truth, read_truth
from spinfilters.run.conditions import contradictions
from spinfilters.simulation.scenario import Scenario, simulate

RECORDINGS = Path(__file__).parents[2] / "../shared/data/disam115"
Change = Callable[[Truth], Truth]

WRONG_ROTATIONS: dict[str, Change] = {
    "rates in axes of the body": lambda t: replace(t, rate_i=rotate(inverse(t.q_ig), t.rate_i)),
    "rates in degrees": lambda t: replace(t, rate_i=np.rad2deg(t.rate_i)),
    "rates of the other sign": lambda t: replace(t, rate_i=-t.rate_i),
    "rates of zero": lambda t: replace(t, rate_i=0 * t.rate_i),
    "attitudes of the inverse": lambda t: replace(t, q_ig=inverse(t.q_ig)),
    "attitudes of a body at rest": lambda t: replace(t, q_ig=np.tile(t.q_ig[:1], (len(t.time), 1))),
}
WRONG_TRANSLATIONS: dict[str, Change] = {
    "velocities in mm/s": lambda t: replace(t, velocity=1e3 * t.velocity),
    "velocities of the other sign": lambda t: replace(t, velocity=-t.velocity),
    "velocities in axes of the body": lambda t: replace(t, velocity=rotate(inverse(t.q_ig), t.velocity)),
    "velocities of zero": lambda t: replace(t, velocity=0 * t.velocity),
}


@pytest.fixture(scope="module")
def truth() -> Truth:
    found = simulate(Scenario.rich()).truth
    assert found is not None
    return found


@pytest.mark.parametrize("change", WRONG_ROTATIONS.values(), ids=WRONG_ROTATIONS)
def test_rates_that_do_not_turn_the_attitudes_are_told(change: Change, truth: Truth) -> None:
    (sentence,) = contradictions(change(truth))
    assert "attitudes" in sentence
    assert len(sentence) < 200


@pytest.mark.parametrize("change", WRONG_TRANSLATIONS.values(), ids=WRONG_TRANSLATIONS)
def test_velocities_that_do_not_carry_the_centre_of_mass_are_told(change: Change, truth: Truth) -> None:
    (sentence,) = contradictions(change(truth))
    assert "centre of mass" in sentence
    assert len(sentence) < 200


def _noisy(truth: Truth, turn: float, length: float) -> Truth:
    """With white noise of rad and rad/s, m and m/s."""
    generator, shape = np.random.default_rng(0), truth.velocity.shape
    return replace(
        truth,
        q_ig=multiply(truth.q_ig, quaternion_from_rotation_vector(turn * generator.standard_normal(shape))),
        rate_i=truth.rate_i + turn * generator.standard_normal(shape),
        center_of_mass=truth.center_of_mass + length * generator.standard_normal(shape),
        velocity=truth.velocity + length * generator.standard_normal(shape),
    )


@pytest.mark.parametrize(("turn", "length"), [(0.0, 0.0), (0.01, 0.002), (0.05, 0.02)])
def test_noise_is_no_contradiction(turn: float, length: float, truth: Truth) -> None:
    assert contradictions(_noisy(truth, turn, length)) == []


@pytest.mark.parametrize("change", WRONG_ROTATIONS.values(), ids=WRONG_ROTATIONS)
def test_a_contradiction_is_told_in_spite_of_noise(change: Change, truth: Truth) -> None:
    assert len(contradictions(change(_noisy(truth, 0.01, 0.002)))) == 1


def test_a_body_that_hovers_in_noise_is_no_contradiction(truth: Truth) -> None:
    noise = 0.01 * np.random.default_rng(1).standard_normal(truth.velocity.shape)
    for position, velocity in ((noise, 0 * noise), (0 * noise, noise), (noise, noise[::-1])):
        assert contradictions(replace(truth, center_of_mass=position, velocity=velocity)) == []


@pytest.mark.parametrize("every", [2, 5, 11, 30])
def test_of_a_body_that_is_seen_too_rarely_nothing_is_said(every: int, truth: Truth) -> None:
    names = ("time", "center_of_mass", "q_ig", "velocity", "rate_i")
    assert contradictions(replace(truth, **{name: getattr(truth, name)[::every] for name in names})) == []


@pytest.mark.parametrize("rows", [1, 2, 3, 5])
def test_of_a_few_rows_nothing_is_said(rows: int, truth: Truth) -> None:
    names = ("time", "center_of_mass", "q_ig", "velocity", "rate_i")
    assert contradictions(replace(truth, **{name: getattr(truth, name)[:rows] for name in names})) == []


def test_a_gap_is_no_contradiction(truth: Truth) -> None:
    names = ("time", "center_of_mass", "q_ig", "velocity", "rate_i")
    rows = np.r_[0:40, 60:115]
    assert contradictions(replace(truth, **{name: getattr(truth, name)[rows] for name in names})) == []


@pytest.mark.parametrize("rate", [1e9, 1e150])
def test_numbers_beyond_all_bounds_are_told_without_a_warning(rate: float, truth: Truth) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (sentence,) = contradictions(
            replace(truth, rate_i=rate * truth.rate_i, velocity=rate * truth.velocity)
        )
    assert "centre of mass" in sentence


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="the recordings beside the repository are not there")
def test_truths_of_recordings_are_quiet() -> None:
    folders = [path.parent for path in sorted(RECORDINGS.glob("*/truth.csv"))]
    assert folders
    for folder in folders:
        found = read_truth(folder)
        assert contradictions(found) == []
