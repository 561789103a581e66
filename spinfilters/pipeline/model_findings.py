"""Errors of the models as findings of the verdict, each with the quantities that it moves."""

from spinfilters.estimators.history import EstimateHistory
from spinfilters.estimators.model_errors.score_test import ScoreTest
from spinfilters.pipeline.tested_models import TestedModels, slow_phrase
from spinfilters.state.quantities import ALL
from spinfilters.state.status import Finding
from spinfilters.verdict.checks import finding
from spinfilters.verdict.moved_quantities import unmoved_quantities
from spinfilters.verdict.wrong_units import WrongUnit


def model_findings(models: TestedModels, tested: EstimateHistory | None) -> list[Finding]:
    """Findings of the tests of a recording's models.

    Parameters
    ----------
    tested : EstimateHistory or None
        Estimate about which the models were tested.
    """
    about = _moved(models, tested)
    found = [finding("front-end-slip", {"text": each.sentence, "cure": each.cure}) for each in models.slips]
    found += [*models.correlated.doubts, *map(_of_unit, models.units)]
    if models.slow is not None:
        numbers = {"text": slow_phrase(models.slow), **_numbers(models.slow)}
        found.append(finding("slow-change", numbers, about))
    found += [finding("unexplained-residuals", {"text": text}) for text in models.unexplained]
    if models.trouble:
        found.append(finding("models-not-tested", {"text": models.trouble}))
    if models.classes:
        names = "+".join("/".join(each.error.name for each in own) for own in models.classes)
        numbers = {"text": models.causes, **_numbers(models.classes[0][0])}
        found.append(finding("model-error", numbers, about, names))
    return found


def _of_unit(unit: WrongUnit) -> Finding:
    return finding("wrong-unit", {"text": unit.sentence, "cure": unit.cure}, unit.about, unit.name)


def _numbers(test: ScoreTest) -> dict[str, float | str]:
    """Statistic and probability of a score test."""
    return {"chi_square": test.statistic, "p_value": test.p_value}


def _moved(models: TestedModels, tested: EstimateHistory | None) -> frozenset[str]:
    """Quantities that removing any of the errors moves which are beyond chance.

    All where that is not known, or where more than what the errors explain is wrong with the residuals.
    """
    if tested is None:
        return ALL
    suspects = _suspects(models)
    if not suspects:
        return ALL
    unmoved = ALL
    for each in suspects:
        unmoved &= unmoved_quantities(tested, each)
    return ALL - unmoved


def _suspects(models: TestedModels) -> list[ScoreTest]:
    """Errors beyond chance, named or not, and those that look like them."""
    beyond = [each for each in models.tests if models.is_beyond_chance(each)]
    return list({id(each): each for each in (*models.named, *beyond)}.values())
