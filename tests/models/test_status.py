"""Verdicts and the sentences that tell of them."""

from spinfilters.models.status import EstimatorStatus, verdict_sentences


def test_estimators_share_the_sentence_of_a_reason_that_they_share():
    doubted = EstimatorStatus().degraded("a sphere predicts as much")
    statuses = {"mekf": doubted, "ukf": EstimatorStatus(), "smoother": doubted.degraded("no end")}
    assert verdict_sentences(statuses) == [
        "mekf, smoother are degraded: a sphere predicts as much",
        "smoother is degraded: no end",
    ]
