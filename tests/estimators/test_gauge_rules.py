"""No rule but the textbook's lets a filter learn where g lies in the body, which nothing observes."""

from functools import cache

import numpy as np
import pytest
from landmark_samples import LAYOUT, recording

from experiments.gauge_information import LARGEST_GROWTH, GaugeCase, gauge_run
from spinfilters.errors import InputError
from spinfilters.estimators.landmarks.gauge_rules import GAUGE_RULES, Point, gauge_rule
from spinfilters.models.anchored_point import anchored_coordinates
from spinfilters.models.gauge import gauge_directions

PROJECTED = ("invariant", "first-estimates", "constrained")
SIGMA = 1e-2
"""Of the prior along the gauge directions, rad and m."""
FRAMES = 12


@cache
def growth(rule, estimator="mekf"):
    """Largest information gained about g in a few frames, relative to the prior's."""
    recorded = recording()
    return gauge_run(
        GaugeCase(estimator, rule, SIGMA), recorded.states[:FRAMES], recorded.timeline[:FRAMES], 0
    ).growth.max()


def points_before_and_after(seed, size):
    """A point and one that an update of this size leads to; four landmarks."""
    generator = np.random.default_rng(seed)
    mean = LAYOUT.retract(LAYOUT.origin(), 0.3 * generator.standard_normal(20))
    mean[2] = 1.5
    points = 0.2 * generator.standard_normal((4, 3))
    anchors = np.tile(mean[:7], (4, 1))
    coordinates = anchored_coordinates(anchors, points)
    error = size * generator.standard_normal(20)
    later = coordinates + size * generator.standard_normal((4, 3))
    return Point(mean, anchors, coordinates), Point(LAYOUT.retract(mean, error), anchors, later), error


def directions(point, coordinates=None):
    landmarks = Point(point.mean, point.anchors, point.coordinates if coordinates is None else coordinates)
    return np.concatenate([gauge_directions(LAYOUT, point.mean), landmarks.landmark_directions()])


def carried(rule, before, after, error):
    """The whole matrix that takes errors about one point to errors about the other."""
    state, landmarks = rule.carried(LAYOUT, before, after, LAYOUT.reset_jacobian(error))
    whole = np.eye(20 + len(landmarks))
    whole[:20, :20], whole[20:, :20] = state, landmarks
    return whole


@pytest.mark.parametrize("rule", PROJECTED)
def test_no_information_is_gained_about_the_frame(rule):
    assert growth(rule) < LARGEST_GROWTH


def test_the_textbook_filter_takes_its_own_corrections_for_information():
    assert growth("standard") > 1e-2


@pytest.mark.parametrize("size", [1e-6, 1e-2, 0.2])
@pytest.mark.parametrize("name", PROJECTED)
def test_directions_before_an_update_become_those_after_it(name, size):
    before, after, error = points_before_and_after(1, size)
    rule = GAUGE_RULES[name]
    first = before.coordinates
    old = directions(before, rule.linearised_at(before.coordinates, first))
    new = directions(after, rule.linearised_at(after.coordinates, first))
    np.testing.assert_allclose(carried(rule, before, after, error) @ old, new, atol=1e-11)


def test_the_textbook_filter_leaves_the_directions_behind():
    before, after, error = points_before_and_after(1, 1e-2)
    moved = carried(GAUGE_RULES["standard"], before, after, error) @ directions(before)
    assert np.abs(moved - directions(after)).max() > 1e-3


@pytest.mark.parametrize("name", GAUGE_RULES)
def test_an_update_that_moves_nothing_changes_no_errors(name):
    before, _, error = points_before_and_after(2, 1e-2)
    np.testing.assert_allclose(carried(GAUGE_RULES[name], before, before, 0 * error), np.eye(32), atol=1e-12)


@pytest.mark.parametrize("name", GAUGE_RULES)
@pytest.mark.parametrize("size", [1e-6, 1e-4])
def test_a_rule_differs_from_the_identity_by_the_size_of_the_correction(name, size):
    before, after, error = points_before_and_after(3, size)
    assert np.abs(carried(GAUGE_RULES[name], before, after, error) - np.eye(32)).max() < 100 * size


@pytest.mark.parametrize("name", GAUGE_RULES)
def test_rules_are_found_by_their_names(name):
    assert gauge_rule(name).name == name


def test_a_rule_that_there_is_not_is_named():
    with pytest.raises(InputError, match="gauge rule 'free' is unknown; use one of standard, invariant"):
        gauge_rule("free")
