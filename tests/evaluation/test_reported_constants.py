"""Reported constants as text."""

import math

from spinfilters.evaluation.estimator_evaluation import numbers_text


def test_numbers_of_which_one_is_none_are_unknown():
    assert numbers_text((1.0, -21.25), ".3g") == "1 -21.2"
    assert numbers_text((1.0, math.nan), ".3g") == "unknown"
