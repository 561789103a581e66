"""Evidence for the verdict on one estimate."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.state.status import Finding, Verdict
from spinfilters.verdict.check import Needs


@dataclass(frozen=True)
class Evidence:
    """All that the verdict on one estimate rests on.

    Attributes
    ----------
    evaluation : Evaluation
        The estimate, with covariances that hold with errors that may be correlated.
    others : Sequence[Evaluation]
        Other estimators of the same measurements that have not failed.
    gate_false_alarm : float
        Probability that a measurement is refused whose noise is as stated.
    found : Sequence[Finding]
        Failed checks of the recording, its initialisation, its noise and its models.
    centre_prior_std : float
        Standard deviation of the centre of mass before anything was measured, m; infinite where it is not known.
    """

    evaluation: Evaluation
    others: Sequence[Evaluation] = ()
    gate_false_alarm: float = 0.0
    found: Sequence[Finding] = field(default_factory=tuple)
    centre_prior_std: float = float("inf")

    @property
    def peers(self) -> list[Evaluation]:
        """Other estimators than this one that have not failed."""
        own = self.evaluation.name
        return [
            each
            for each in self.others
            if each.name != own and each.history.status.verdict is not Verdict.FAILED
        ]

    @property
    def present(self) -> frozenset[Needs]:
        """What the tests of an estimate can be computed from.

        A smoother of the same measurements and residuals are tested where they arise, and come as findings.
        """
        own = {Needs.RECORDING, Needs.ESTIMATE}
        if self.evaluation.nis_ratio is not None:
            own.add(Needs.FILTER)
        if self.peers:
            own.add(Needs.PEERS)
        return frozenset(own)
