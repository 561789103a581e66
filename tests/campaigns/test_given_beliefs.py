"""Beliefs that are given: filters are held against the smoother where these are too wide for a linearisation."""

from spinfilters.campaigns.runner import Runner
from spinfilters.campaigns.study import study_from
from spinfilters.models.status import Verdict
from spinfilters.verdict.filter_diagnostics import reference_smoother

WRONG = 2
"""A seed whose filter ends 5.4 of its deviations off in a moment."""


def runner(mass_distribution: float) -> Runner:
    """Of a body that spins steadily about its major axis, its moments nearly those of an axially symmetric one."""
    document = {
        "study": {
            "name": "given",
            "description": "of a test",
            "seeds": 3,
            "initialisation": "drawn",
            "bound": "none",
        },
        "factors": {"estimator": ["mekf"]},
        "motion": {"base": {"rate_rpm": [10.0, 0.0, 0.0]}},
        "body": {"base": {"principal_moments": [1.0, 0.9995, 0.6]}},
        "sensor": {"base": {"known_map": True}},
        "belief": {"base": {"mass_distribution": mass_distribution}},
    }
    return Runner(study_from(document, "given.toml"))


def test_a_filter_that_went_astray_from_a_wide_belief_is_not_called_ok() -> None:
    wide = runner(0.1)
    (found,) = wide.compared(wide.study.run(WRONG), with_bound=False).evaluations
    status = found.history.status
    assert status.verdict is Verdict.DEGRADED
    assert any(found.check == "over-confident" for found in status.findings)


def test_nothing_is_smoothed_where_the_belief_is_narrow() -> None:
    narrow = runner(0.05)
    setup, settings = narrow.setup(narrow.study.run(0)), narrow.study.cells[0].settings
    assert setup.is_given
    assert reference_smoother([], setup, settings) is None
