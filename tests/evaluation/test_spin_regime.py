"""Tumbles or spins: the rate of an estimate against the thresholds of missions."""

from dataclasses import replace

import numpy as np
import pytest

from spinfilters.core.conventions import RPM
from spinfilters.core.spin_threshold import SpinRegime, spin_threshold
from spinfilters.evaluation.spin_regime import MISSIONS, spin_verdict
from tests.plots.run_samples import full_runs


def at_rate(rpm: float, std_rpm: float = 0.01):
    """An evaluation whose rate is about one axis of g."""
    evaluation = full_runs().with_truth[0]
    history = evaluation.history
    mean, factor = history.mean.copy(), history.factor.copy()
    mean[:, history.layout.mean_slice("w")] = [0.0, rpm * RPM, 0.0]
    factor[:, history.layout.slice("w")] = 0.0
    rows = np.arange(history.layout.error_dim)[history.layout.slice("w")]
    factor[:, rows, rows] = std_rpm * RPM
    return evaluation.with_fields(history=replace(history, mean=mean, factor=factor))


@pytest.mark.parametrize(
    ("rpm", "spheres", "orbital_express"),
    [
        (10.0, SpinRegime.SPINNING, SpinRegime.SPINNING),
        (1.0, SpinRegime.TUMBLING, SpinRegime.SPINNING),
        (0.05, SpinRegime.TUMBLING, SpinRegime.TUMBLING),
    ],
)
def test_the_regime_is_that_of_the_missions_limits(
    rpm: float, spheres: SpinRegime, orbital_express: SpinRegime
) -> None:
    found = spin_verdict(at_rate(rpm))
    assert found is not None
    assert found.rate == pytest.approx(rpm * RPM)
    assert found.regimes == {"SPHERES": spheres, "Orbital Express": orbital_express}
    assert found.sentence.startswith(f"{rpm:.3g} +- 0.01 rpm, mostly about the ")
    assert found.document["regimes"]["SPHERES"] == spheres.value


def test_a_rate_within_its_deviation_of_the_limit_is_open() -> None:
    limit = spin_threshold(MISSIONS["SPHERES"]).overall / RPM
    found = spin_verdict(at_rate(limit + 0.02))
    assert found is not None
    assert found.regimes["SPHERES"] is None
    assert "at the limit for one like SPHERES" in found.sentence


def test_an_estimate_without_numbers_has_no_verdict() -> None:
    assert spin_verdict(at_rate(float("nan"))) is None


def test_a_body_that_nothing_sees_from_outside_has_its_rate_and_no_missions() -> None:
    found = spin_verdict(at_rate(10.0))
    assert found is not None
    assert "SPHERES" in found.sentence
    alone = replace(found, is_seen=False)
    assert "SPHERES" not in alone.sentence
    assert alone.document == found.document
