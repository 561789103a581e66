"""Doubts about estimates that their own numbers do not show."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plain_comparison import plain_comparison

from experiments.honest_cases import RecordingCase, recordings
from spinfilters.models.status import Finding
from spinfilters.run.estimation import Comparison
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import AUTO, ProcessSettings, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map, without_noise
from spinfilters.verdict import filter_diagnostics as estimate_diagnostics
from spinfilters.verdict.filter_diagnostics import (
    LEAST_EVIDENCE,
    InertiaEvidence,
    agreement_diagnostics,
    inertia_evidence,
    motion_diagnostics,
    reference_smoother,
)

SETTINGS = Settings(estimators=("mekf", "smoother"))
STEADY = RecordingCase(
    "steady gyro", moments=(1.0, 0.7, 0.5), rate_rpm=(10.0, 0.0, 0.0), psd=1e-12, epochs=120
)
RICH = RecordingCase("rich gyro", rate_rpm=RICH_RPM, epochs=120)


@cache
def compared(case: RecordingCase, seed: int = 0) -> Comparison:
    """MEKF and smoother on a recording whose stated noise is true."""
    return plain_comparison(recordings(case, seed + 1)[seed].dataset, SETTINGS)


def test_a_filter_that_agrees_with_the_smoother_is_not_doubted() -> None:
    mekf, smoother = compared(RICH).evaluations
    assert agreement_diagnostics(mekf, smoother.history) == []


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_a_filter_that_states_too_little_is_doubted_with_the_number(share: float) -> None:
    mekf, smoother = compared(RICH).evaluations
    factor = share * mekf.history.factor
    (found,) = agreement_diagnostics(
        mekf.with_fields(history=replace(mekf.history, factor=factor)), smoother.history
    )
    assert float(found.numbers["times"]) == pytest.approx(1 / share, rel=0.35)
    assert f"are {found.numbers['times']:.2g} times its stated standard deviations" in found.reason
    assert len(found.reason) < 300


def test_a_wide_smoother_beside_a_wide_filter_is_no_doubt() -> None:
    mekf, smoother = compared(RICH).evaluations
    wide = [replace(each.history, factor=3 * each.history.factor) for each in (mekf, smoother)]
    assert agreement_diagnostics(mekf.with_fields(history=wide[0]), wide[1]) == []


def test_nothing_is_smoothed_for_filters_that_began_from_a_well_known_motion() -> None:
    setup = compared(RICH).setup
    assert reference_smoother([], setup, SETTINGS) is None
    assert reference_smoother([], replace(setup, initial=replace(setup.initial, departure=5.0)), SETTINGS)


def test_a_filter_that_began_from_vague_moments_is_held_against_a_smoother() -> None:
    setup = compared(RICH).setup
    vague = replace(setup.initial, factor=30 * setup.initial.factor)
    assert reference_smoother([], replace(setup, initial=vague), SETTINGS)


def test_what_is_said_of_vague_moments_is_said_only_where_no_smoother_is() -> None:
    mekf, smoother = compared(RICH).evaluations
    vague = [Finding("vague-initialisation", "vague")]
    assert agreement_diagnostics(mekf, smoother.history, vague) == []
    assert agreement_diagnostics(mekf, None, vague) == vague
    nothing = replace(smoother.history, factor=np.full_like(smoother.history.factor, np.nan))
    assert agreement_diagnostics(mekf, nothing, vague) == vague


def test_a_mass_distribution_that_states_too_little_is_doubted_by_itself() -> None:
    mekf, smoother = compared(RICH).evaluations
    factor = mekf.history.factor.copy()
    factor[:, mekf.history.layout.slice("s")] /= 2.5
    (found,) = agreement_diagnostics(
        mekf.with_fields(history=replace(mekf.history, factor=factor)), smoother.history
    )
    assert "of the mass distribution" in found.sentence
    assert found.about == {"moments", "axes"}


def evidence(case: RecordingCase, seed: int = 0) -> float:
    """Of a recording's inertia."""
    found = inertia_evidence(compared(case, seed).setup, SETTINGS)
    assert found is not None
    return found.total


def test_the_moments_of_a_rich_motion_are_determined() -> None:
    assert motion_diagnostics(compared(RICH).setup, SETTINGS) == []
    assert evidence(RICH) > 100 * LEAST_EVIDENCE


@pytest.mark.parametrize("seed", range(2))
def test_a_steady_spin_does_not_determine_moments(seed: int) -> None:
    run = compared(STEADY, seed)
    (found,) = motion_diagnostics(run.setup, SETTINGS)
    assert "a steady spin shows its axis only" in found.sentence
    assert len(found.reason) < 300
    assert all(evaluation.history.status.verdict != "ok" for evaluation in run.evaluations)


def test_few_epochs_are_no_steady_spin(monkeypatch: pytest.MonkeyPatch) -> None:
    found = InertiaEvidence(0.0, 3)
    monkeypatch.setattr(estimate_diagnostics, "inertia_evidence", lambda *_: found)
    (found,) = motion_diagnostics(compared(RICH).setup, SETTINGS)
    assert found.sentence.endswith("they are too few")


@pytest.mark.parametrize("kind", ["gyro", "pose"])
@pytest.mark.parametrize("stated", [True, False])
def test_an_undetermined_body_takes_disturbances_whose_density_is_identified(
    kind: str, stated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a density 30 times too small attitudes and rates of tracks were up to 6 deviations off, and said to hold."""
    monkeypatch.setattr(estimate_diagnostics, "inertia_evidence", lambda *_: InertiaEvidence(0.0, 40))
    process = ProcessSettings(gravity=False, torque_psd=1e-6 if stated else AUTO)
    scenario = Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=20)
    setup = prepare(without_noise(simulate(scenario)), Settings(process=process))
    (found,) = motion_diagnostics(setup, SETTINGS)
    assert found.about is not None
    assert ({"attitude", "rate"} <= found.about) is not stated
    assert ("position" in found.about) is (kind == "pose")


def test_the_lack_of_wobble_under_a_disturbance_that_is_not_there_is_no_evidence() -> None:
    stated = replace(SETTINGS, process=ProcessSettings(torque_psd=1e-6))
    setup = prepare(recordings(STEADY, 1)[0].dataset, stated)
    assert motion_diagnostics(setup, stated)


def test_an_unknown_map_tells_as_well_that_a_motion_is_rich() -> None:
    dataset = without_map(simulate(Scenario.simplified(rate_rpm=RICH_RPM, landmarks=300, epochs=70)))
    setup = prepare(dataset, SETTINGS)
    found = inertia_evidence(setup, SETTINGS)
    assert setup.initial.has_landmarks
    assert found is not None
    assert found.total > LEAST_EVIDENCE


def test_an_initialisation_that_failed_has_no_evidence() -> None:
    setup = compared(RICH).setup
    failed = type(setup.initial).failed(setup.process.layout, 60, "for a test")
    assert inertia_evidence(replace(setup, initial=failed), SETTINGS) is None
