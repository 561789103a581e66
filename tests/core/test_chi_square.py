"""Tails and medians are those of scipy.stats, which nothing of a run imports."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats
from scipy.special import chdtrc

from spinfilters.core.chi_square import chi_square_median, chi_square_tail, fisher_tail

VALUES = np.array([-1.0, 0.0, 1e-12, 0.3, 4.0, 60.0, 900.0, np.inf, np.nan])


@pytest.mark.parametrize("dof", [0.5, 1.0, 3.0, 240.0, 7e4])
def test_tails_and_medians_are_those_of_scipy(dof: float) -> None:
    np.testing.assert_allclose(chi_square_tail(VALUES, dof), stats.chi2.sf(VALUES, dof), rtol=1e-12)
    assert chi_square_median(dof) == pytest.approx(stats.chi2.median(dof), rel=1e-13)
    for value in VALUES[:-1]:
        assert fisher_tail(value, 3.0, dof) == pytest.approx(stats.f.sf(value, 3.0, dof), rel=1e-10)


def test_a_worker_of_a_campaign_does_not_import_scipy_stats() -> None:
    program = "import sys, spinfilters.campaigns.runner; sys.exit('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_tails_of_three_degrees_in_closed_form_are_those_of_the_general_series() -> None:
    values = np.concatenate([[-1.0, 0.0, 1e-300, 1e-9], np.logspace(-3, 3, 100), [1e5, np.inf]])
    expected = chdtrc(3, np.maximum(values, 0.0))
    np.testing.assert_allclose(chi_square_tail(values, 3), expected, rtol=1e-12, atol=1e-300)
    assert np.isnan(chi_square_tail(np.array([np.nan]), 3)).all()
