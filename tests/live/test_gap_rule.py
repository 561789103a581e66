"""Times far ahead: one is not believed, two are."""

from spinfilters.live.executive import GapRule
from spinfilters.live.sources import ArrivedEpoch


def used_rule(interval: float = 0.1) -> GapRule:
    rule = GapRule(60.0)
    for _ in range(10):
        assert not rule.passed(interval)
    return rule


def test_one_time_far_ahead_is_kept_back_and_forgotten_when_time_goes_on() -> None:
    rule = used_rule()
    assert rule.jump(ArrivedEpoch(50.0, ()), 1.0) == (True, None)
    assert rule.jump(ArrivedEpoch(1.1, ()), 1.0) == (False, None)
    assert rule.jump(ArrivedEpoch(50.1, ()), 1.1) == (True, None)


def test_a_second_epoch_that_follows_confirms_the_first() -> None:
    rule, first = used_rule(), ArrivedEpoch(50.0, ())
    rule.jump(first, 1.0)
    assert rule.jump(ArrivedEpoch(50.1, ()), 1.0) == (False, first)


def test_a_gap_of_a_few_intervals_is_believed_at_once_and_counted() -> None:
    rule = used_rule()
    assert rule.jump(ArrivedEpoch(1.5, ()), 1.0) == (False, None)
    assert rule.passed(0.5)
