"""What holds of an estimate, in one short line."""

from spinfilters.evaluation.estimator_evaluation import Evaluation
from spinfilters.state.quantities import LABELS, TRANSLATION
from spinfilters.state.status import Holds, Verdict


def held_text(evaluation: Evaluation) -> str:
    """What holds of an estimate, "all but moments, axes" or "only position, rate", whichever is shorter.

    Quantities that its sensors cannot see are left out; empty of an estimate that has not been judged.
    """
    status, layout = evaluation.history.status, evaluation.history.layout
    names = [name for name in status.holds if layout.translates or name not in TRANSLATION]
    good = [LABELS[name] for name in names if status.holds[name] is Holds.OK]
    other = [LABELS[name] for name in names if status.holds[name] is not Holds.OK]
    if not names:
        return ""
    if not good or status.verdict is Verdict.FAILED:
        return "nothing"
    if not other:
        return "all"
    return f"all but {', '.join(other)}" if len(other) <= len(good) else f"only {', '.join(good)}"
