"""Dead-band motion of one axis stays within its band, however long."""

import numpy as np
import pytest

from spinfilters.simulation import inspector as limit_cycle

BAND, PULSE, PUSH = 0.01, 0.002, 1e-4


@pytest.mark.parametrize("push", [0.0, PUSH])
def test_a_recording_of_years_draws_few_arcs_and_stays_in_the_band(
    push: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    leaves = limit_cycle._exit_from_band  # pyright: ignore[reportPrivateUsage]

    def counted(*arguments: float) -> tuple[float, float]:
        drawn.append(arguments)
        return leaves(*arguments)

    monkeypatch.setattr(limit_cycle, "_exit_from_band", counted)
    cycle = limit_cycle.limit_cycle(BAND, PULSE, push, np.random.default_rng(3))
    years = cycle(np.linspace(0.0, 1e9, 1000))
    assert len(drawn) < 2 * limit_cycle.MOST_ARCS
    assert np.abs(years).max() <= BAND * (1 + 1e-9)
    assert np.std(years) > 0.2 * BAND


def test_the_path_is_continuous_where_it_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limit_cycle, "MOST_ARCS", 12)
    cycle = limit_cycle.limit_cycle(BAND, PULSE, PUSH, np.random.default_rng(3))
    time = np.linspace(0.0, 1000.0, 100_001)
    assert np.abs(np.diff(cycle(time))).max() < 0.01 * 4 * PULSE


def test_a_longer_recording_begins_as_a_shorter_one() -> None:
    time = np.linspace(0.0, 100.0, 50)
    short, long = (limit_cycle.limit_cycle(BAND, PULSE, PUSH, np.random.default_rng(5)) for _ in range(2))
    long(np.array([1e9]))
    np.testing.assert_array_equal(short(time), long(time))
