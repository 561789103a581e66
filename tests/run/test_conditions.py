"""A comparison says what it was made under: map, noise, seed; and a data set's own noise is what estimators are told."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.models.process import THESIS_NOISE, ProcessNoise
from spinfilters.run.conditions import Conditions, conditions_of, contradictions, told_sentences
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import ProcessSettings, Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate, without_map

TRACKS = Scenario.simplified(rate_rpm=RICH_RPM, epochs=12, landmarks=60, seed=5)


@cache
def conditions(scenario: Scenario, settings: Settings | None = None, known: bool = True) -> Conditions:
    """Of a simulated data set, with its map or without."""
    dataset = simulate(scenario)
    return conditions_of(prepare(dataset if known else without_map(dataset), settings or Settings()))


def test_the_map_is_known_unknown_or_there_is_none() -> None:
    assert conditions(TRACKS).map == "known"
    assert conditions(TRACKS).landmarks == 60
    unknown = conditions(TRACKS, known=False)
    assert (unknown.map, unknown.landmarks) == ("unknown", None)
    assert conditions(replace(TRACKS, kind="gyro")).map is None


def test_the_sentences_have_every_noise_with_its_unit_and_the_seed() -> None:
    first, second = conditions(TRACKS, known=False).sentences
    assert first == "Map unknown. Seed 5."
    assert second == (
        "Noise: pixels 1 px; disturbances: force 4e-08 (m/s^2)^2/Hz, torque 1e-06 (rad/s^2)^2/Hz."
    )
    assert "gyro 0.002 rad/s" in conditions(replace(TRACKS, kind="gyro")).sentences[1]
    assert "positions 0.005 m, attitudes 0.01 rad" in conditions(replace(TRACKS, kind="pose")).sentences[1]


def test_noise_is_what_the_estimators_are_told_whatever_was_simulated() -> None:
    told = Settings(process=ProcessSettings(force_psd=3e-5))
    noise = conditions(TRACKS, told).document["noise"]
    stated = {"std": None, "upper": None, "source": "stated"}
    assert noise["force_psd"] == {"value": 3e-5, "unit": "(m/s^2)^2/Hz"} | stated
    assert noise["torque_psd"] == {"value": 1e-6, "unit": "(rad/s^2)^2/Hz"} | stated


def test_disturbances_are_the_data_sets_own_and_identified_where_it_is_silent() -> None:
    dataset = simulate(replace(TRACKS, noise=ProcessNoise(2e-7, 3e-7)))
    assert prepare(dataset, Settings()).process.noise == ProcessNoise(2e-7, 3e-7)
    silent = replace(dataset, options=replace(dataset.options, force_psd=None, torque_psd=None))
    setup = prepare(silent, Settings())
    levels = {each.name: each for each in setup.identified}
    assert set(levels) == {"force_psd", "torque_psd"}
    assert not any(each.told for each in levels.values()), "twelve epochs tell a bound alone"
    assert 2e-7 < setup.process.noise.force_psd < levels["force_psd"].upper
    assert 3e-7 < setup.process.noise.torque_psd < levels["torque_psd"].upper


def test_disturbances_are_those_of_the_thesis_where_the_initialisation_is_given() -> None:
    dataset = simulate(replace(TRACKS, noise=ProcessNoise(2e-7, 3e-7)))
    silent = replace(dataset, options=replace(dataset.options, force_psd=None, torque_psd=None))
    belief = prepare(dataset, Settings()).initial
    assert prepare(silent, Settings(), lambda layout: belief).process.noise == THESIS_NOISE


def test_a_density_that_is_not_positive_is_refused() -> None:
    with pytest.raises(InputError, match=r"force_psd is -1\.0; give 0 or a number from"):
        replace(simulate(TRACKS).options, force_psd=-1.0)


def test_a_summary_tells_its_sentences_and_nothing_else_is_taken_for_one() -> None:
    document = conditions(TRACKS).document
    assert told_sentences({"conditions": document}) == document["sentences"]
    for strange in ({}, {"conditions": 3}, {"conditions": {"sentences": "no list"}}):
        assert told_sentences(strange) == []
    assert told_sentences({"conditions": {"sentences": [3, "a\x1b[2J", "good"]}}) == ["good"]


def test_a_truth_that_contradicts_itself_is_told_with_the_conditions_and_no_other() -> None:
    dataset = simulate(replace(TRACKS, kind="gyro"))
    truth = dataset.truth
    assert truth is not None
    assert conditions_of(prepare(dataset, Settings())).contradictions == ()
    wrong = replace(dataset, truth=replace(truth, rate_i=-truth.rate_i))
    told = conditions_of(prepare(wrong, Settings()))
    assert "CONTRADICTS" in told.sentences[-1]
    assert told.document["truth_contradictions"] == [told.sentences[-1]]
    assert told_sentences({"conditions": told.document}) == told.sentences


def test_a_centre_of_mass_that_moves_by_rounding_alone_contradicts_nothing() -> None:
    truth = simulate(TRACKS).truth
    assert truth is not None
    rest = np.tile([32.4, 0.0, 0.0], (len(truth.time), 1))
    rest[1::2, 1] = 7.6e-19
    still = replace(truth, center_of_mass=rest, velocity=np.zeros_like(rest))
    assert contradictions(still) == []
    assert len(contradictions(replace(still, center_of_mass=rest + truth.time[:, None]))) == 1
