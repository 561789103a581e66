"""Whether poses fall is asked of few solutions, all of the same epochs."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.honest_cases import RecordingCase, recordings
from spinfilters.inference import initial_estimate as initialiser
from spinfilters.inference.initial_estimate import InitialEstimate
from spinfilters.inference.setup import Setup
from spinfilters.io.dataset import Dataset
from spinfilters.models.state_blocks import ACCELERATION
from spinfilters.run import preparation as acceleration_state
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import without_noise
from spinfilters.verdict.model_tests import minus_twice_log_evidence

MOST_SOLUTIONS = 30
"""Of a steady spin of poses with nothing stated."""


def steady(epochs: int) -> Dataset:
    """Poses of a steady spin, with no noise stated."""
    case = RecordingCase("steady", "pose", rate_rpm=(9.0, 0.0, 0.0), psd=1e-8, epochs=epochs)
    return without_noise(recordings(case, 1)[0].dataset)


def thrown(noise_std: float = 0.002, psd: float = 1e-8) -> Dataset:
    """A fifth of a turn of a body that falls."""
    case = RecordingCase(
        "thrown",
        "pose",
        rate_rpm=(20.0, 9.0, 4.0),
        psd=psd,
        epochs=24,
        interval=0.01,
        noise_std=noise_std,
    )
    dataset = recordings(case, 1)[0].dataset
    (stream,) = dataset.log.streams
    values = stream.values.copy()
    values[:, 2] -= 9.81 * stream.time**2 / 2
    return replace(dataset, log=replace(dataset.log, streams=(replace(stream, values=values),)))


@pytest.fixture
def solutions(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of epochs of all solutions."""
    counts: list[int] = []
    smooth = initialiser.smooth_first_epochs

    def counted(*arguments: object) -> InitialEstimate:
        found = smooth(*arguments)  # pyright: ignore[reportArgumentType]
        counts.append(len(found.mean))
        return found

    monkeypatch.setattr(initialiser, "smooth_first_epochs", counted)
    return counts


def test_a_steady_spin_takes_few_solutions_and_has_no_acceleration(solutions: list[int]) -> None:
    setup = prepare(steady(40), Settings())
    assert not setup.process.layout.has(ACCELERATION)
    assert len(solutions) <= MOST_SOLUTIONS


def test_poses_without_noise_that_fall_have_an_acceleration() -> None:
    setup = prepare(without_noise(thrown(noise_std=1e-9, psd=0.0)), Settings())
    assert setup.process.layout.has(ACCELERATION)


def test_priors_of_the_centre_are_weighed_as_fits_with_each_weigh_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    different: dict[float, float] = {}
    weighed = acceleration_state.explanations_with_acceleration

    def fitted(without: Setup, settings: Settings) -> list[acceleration_state.AccelerationExplanation]:
        found = weighed(without, settings)
        for each in found:
            options = replace(settings.initialisation, centre_std=each.centre_std)
            own = replace(settings, process=replace(settings.process, gravity=True), initialisation=options)
            setup = acceleration_state.setup_beside(without, own)
            assert len(setup.initial.mean) == len(setup.timeline)
            cost = minus_twice_log_evidence(setup, setup.initial.mean)
            assert cost is not None
            cost += 2 * float(np.log(setup.initial.prior.std).sum())
            different[each.centre_std] = each.cost - cost
        return found

    monkeypatch.setattr(acceleration_state, "explanations_with_acceleration", fitted)
    setup = prepare(thrown(), Settings())
    assert setup.process.layout.has(ACCELERATION)
    assert len(different) == 4
    assert np.abs(list(different.values())).max() < 0.1
