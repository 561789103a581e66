"""The table of errors that models may have."""

from spinfilters.estimators.model_errors.alternative import table


def test_every_alternative_says_what_it_is_and_what_to_do() -> None:
    for name, each in table().items():
        assert name == each.name
        assert each.phrase
        assert each.unit
        assert 10 < len(each.cure) < 120
        assert (each.block is None) == (not each.held_by)
