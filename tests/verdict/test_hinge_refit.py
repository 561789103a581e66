"""A hinge that a motion has bent to is named with its size, which one linear step falls short of."""

from dataclasses import replace
from functools import cache

import numpy as np
from plain_comparison import plain_comparison
from smoothed_motions import motion_near

from spinfilters.models.process import ProcessNoise
from spinfilters.run.estimation import Comparison
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.model_faults import OPENED, faulty_recording, model_faults
from spinfilters.simulation.scenario import RICH_RPM, Scenario
from spinfilters.verdict.model_errors.alternatives import FLYWHEEL, HINGE
from spinfilters.verdict.model_errors.error_columns import CHANGES, hinge_drive
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.verdict.refits import DoubtedMotion, with_hinge_refit

SETTINGS = Settings(estimators=("smoother",), process={"gravity": False})  # pyright: ignore[reportArgumentType]
SCENARIO = Scenario.simplified(
    kind="gyro",
    principal_moments=(1.0, 0.8, 0.55),
    rate_rpm=RICH_RPM,
    epochs=60,
    interval=0.2,
    noise=ProcessNoise(1e-8, 1e-8),
)
WIDE = 0.6
"""Share of the moments that the hinge moves."""


@cache
def compared() -> Comparison:
    """Rates of a body with a hinge."""
    seeds = tuple(np.random.SeedSequence(1).spawn(3))
    return plain_comparison(faulty_recording(SCENARIO, model_faults()["hinge"], WIDE, seeds), SETTINGS)


@cache
def motion() -> SmoothedMotion:
    """The smoothed motion of that recording."""
    (evaluation,) = compared().evaluations
    return motion_near(compared().setup, evaluation.history.mean)


def test_the_derivative_of_what_a_hinge_drives_is_that_of_finite_differences() -> None:
    size, step = np.array([0.1, -0.05, 0.2, 0.1, -0.1, 0.1]), 1e-6
    for k, unit in enumerate(np.eye(6)):
        ahead, behind = (hinge_drive(motion(), size + sign * step * unit).angular for sign in (1, -1))
        found = hinge_drive(motion(), size).by_size[:, :, k]
        np.testing.assert_allclose(found, (ahead - behind) / (2 * step), atol=1e-6)


def test_a_fit_finds_the_size_of_a_hinge_that_its_score_falls_short_of() -> None:
    models, (evaluation,) = compared().models, compared().evaluations
    hinge, flywheel = models.test_of(HINGE), models.test_of(FLYWHEEL)
    assert hinge is not None
    assert flywheel is not None
    # as if a flywheel explained more than one linear step of a hinge does
    models = replace(models, tests=(flywheel, hinge))
    found = with_hinge_refit(models, DoubtedMotion(compared().setup, evaluation.history.mean)).tests[0]
    assert found.error is HINGE
    moments = np.array(SCENARIO.principal_moments)
    truth = WIDE * OPENED / 2 / np.sqrt(np.outer(moments, moments))
    falls_short, fitted = (
        np.tensordot(each.size, CHANGES[: len(each.size)], axes=1) for each in (hinge, found)
    )
    assert found.gain > hinge.gain + 100.0
    assert np.linalg.norm(fitted - truth) < 0.3 * np.linalg.norm(falls_short - truth)
