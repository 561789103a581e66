"""The verdict on one estimate: a loop over the list of checks."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from spinfilters.state.status import EstimatorStatus, Finding, Verdict
from spinfilters.verdict.check import base_name
from spinfilters.verdict.checks import BY_NAME, CHECKS, check_of
from spinfilters.verdict.evidence import Evidence
from spinfilters.verdict.holding import holding


def judge(evidence: Evidence) -> EstimatorStatus:
    """Status of an estimate: certain causes, its own findings, then those of every check, and what still holds.

    An estimate is ``failed`` where it says so, or where its moments are not finite; any other finding makes it ``degraded``.
    """
    evaluation = evidence.evaluation
    status = evaluation.history.status
    if not np.isfinite(evaluation.body.principal_moments_std).all() and status.verdict is not Verdict.FAILED:
        status = status.failed("the moments of inertia at the end are not finite")
    status = replace(status, findings=tuple(_with_cure(each) for each in status.findings))
    for each in findings_of(evidence):
        status = status.doubted(each)
    status = replace(status, findings=_causes_first(status.findings))
    return replace(status, holds=holding(evidence, status))


def _causes_first(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings with certain causes at the front, and without the cures of what may follow from these.

    Such a cure ("raise process.torque_psd") would hide the cause. A cause reaches the findings that are about its quantities alone.
    """
    causes = [each for each in findings if check_of(each).is_cause]
    reached = frozenset[str]().union(*map(_about, causes))
    others = [each for each in findings if each not in causes]
    follows = [check_of(each).may_follow and _about(each) <= reached for each in others]
    without = [replace(each, cure="") if gone else each for each, gone in zip(others, follows, strict=True)]
    return (*causes, *(without if causes else others))


def _about(found: Finding) -> frozenset[str]:
    return check_of(found).about if found.about is None else found.about


def findings_of(evidence: Evidence) -> Iterator[Finding]:
    """Findings of all checks, in their order; those of names that are not in the list at the end."""
    for check in CHECKS:
        yield from (_with_cure(each) for each in evidence.found if base_name(each.check) == check.name)
        if check.test is not None and check.needs in evidence.present:
            yield from (check.finding(each.numbers, each.about) for each in check.test(evidence))
    yield from _unlisted(evidence.found)


def _unlisted(found: Sequence[Finding]) -> Iterator[Finding]:
    return (each for each in found if base_name(each.check) not in BY_NAME)


def _with_cure(found: Finding) -> Finding:
    """A finding whose words were written where it arose, with the cure of its check."""
    return found if found.cure or found.numbers else replace(found, cure=check_of(found).cure)
