"""Evidence that the body rate varies by its inertia, rather than by disturbances and noise.

A body that spins steadily about a principal axis tells that axis and nothing else of its inertia. An estimator that expects
disturbances takes the lack of wobble for information all the same, or what noise leaves in its rates for a wobble. So two filters
go on from the initialisation: one with the body that it found, one with a sphere, which keeps any rate. What they predict of each
epoch before they see it tells which is nearer,

    evidence = 2 (ln p(measurements | body) - ln p(measurements | sphere)),

disturbances and noise being the same. A body fitted to noise gains nothing by it: the fit and what judges it are different epochs.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from spinfilters.errors import NUMERICAL_ERRORS
from spinfilters.estimators.filters.multiplicative_ekf import MultiplicativeEkf
from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.run import run
from spinfilters.pipeline.setup import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.state.blocks.rigid_body import MASS_DISTRIBUTION
from spinfilters.state.gaussian import Gaussian
from spinfilters.state.status import Verdict

MOST_EPOCHS = 1000
"""That are looked at: a motion that does not tell itself in these is taken for one that does not."""
SMALLEST_REFUSAL = 1e-12
"""Probability of a refused measurement, where there is no gate."""
NOT_FINITE = 1e9
"""Evidence of a sphere whose numbers lead nowhere where those of the body do."""


@dataclass(frozen=True)
class InertiaEvidence:
    """Evidence for the inertia of the initialisation beside a sphere.

    Attributes
    ----------
    total: twice the logarithm of the likelihood ratio.   epochs: that it was gathered over.
    """

    total: float
    epochs: int


def inertia_evidence(setup: Setup, settings: Settings) -> InertiaEvidence | None:
    """Inertia evidence of the epochs behind the initialisation.

    None where that has failed or is followed by none.
    """
    first = len(setup.initial.mean)
    rest = min(len(setup.timeline) - first, MOST_EPOCHS)
    if setup.initial.has_failed or rest < 1 or not np.isfinite(setup.belief.factor).all():
        return None
    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            body, sphere = (
                _predicted(setup, settings, belief) for belief in (setup.belief, _as_sphere(setup.belief))
            )
    except NUMERICAL_ERRORS:
        return InertiaEvidence(0.0, rest)
    if body.status.verdict is Verdict.FAILED:
        return InertiaEvidence(0.0, len(body.time))
    if sphere.status.verdict is Verdict.FAILED:
        return InertiaEvidence(NOT_FINITE, len(body.time))
    return InertiaEvidence(_evidence(body, sphere, settings), len(body.time))


def _predicted(setup: Setup, settings: Settings, belief: Gaussian | LandmarkBelief) -> EstimateHistory:
    first = len(setup.initial.mean)
    ekf = MultiplicativeEkf(setup.process, settings.robust, landmarks=settings.landmarks)
    ekf.start(belief)
    return run(ekf, setup.end_of_initialisation, setup.timeline[first : first + MOST_EPOCHS])


def _as_sphere(belief: Gaussian | LandmarkBelief) -> Gaussian | LandmarkBelief:
    """The belief about everything else, of a body whose inertia is known to be a sphere's."""
    layout, name = belief.layout, MASS_DISTRIBUTION.name
    mean, factor = belief.mean.copy(), belief.factor.copy()
    mean[layout.mean_slice(name)], factor[layout.slice(name)] = 0.0, 0.0
    return replace(belief, mean=mean, factor=factor)


def _evidence(body: EstimateHistory, sphere: EstimateHistory, settings: Settings) -> float:
    """Evidence by epoch.

    The likelihoods count where both used as much, else the squares, a refused value taken for one at the gate.
    """
    alike = body.accepted == sphere.accepted
    likelihoods = 2 * (body.log_likelihood - sphere.log_likelihood)
    refused = max(1.0 - settings.robust.gate_probability, SMALLEST_REFUSAL)
    dimension = body.dof.sum() / max(body.accepted.sum(), 1)
    at_gate = float(chdtri(max(dimension, 1.0), refused))
    squares = sphere.nis - body.nis + at_gate * (sphere.rejected - body.rejected)
    return float(np.where(alike, likelihoods, squares).sum())
