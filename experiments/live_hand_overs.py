"""Gain of a filter from the smoother's hand-overs.

A filter of tracks without a map, without a clock.
    python -m experiments.live_hand_overs [--seeds 4] [--epochs 130] [--every 10] [--late 10] [--filters mekf,embedded]

Simulates tracks at 10 Hz of a body that stays in view. Every so many epochs the smoother, once it says that it has settled, hands
state and landmarks over, as late as it would come; the filter goes back, takes them and does later epochs again. Prints, over
seeds, rms errors of position and attitude and the mean NEES per degree of freedom of the filter alone, of the filter with
hand-overs, of those of its answers that directly follow a hand-over, and of the smoother at these epochs.
"""

import argparse
from dataclasses import replace

import numpy as np

from experiments.command_line import run_study
from spinfilters.evaluation.estimator_evaluation import evaluate
from spinfilters.evaluation.trajectory_errors import Alignment
from spinfilters.filters.estimator import Estimator
from spinfilters.filters.history import EstimateHistory, GrowingHistory
from spinfilters.filters.shared_modes import LandmarkOptions
from spinfilters.filters.timeline import Epoch
from spinfilters.inference.setup import Setup
from spinfilters.inference.smoother_run import begin_after_initialisation, sliding_smoother
from spinfilters.live.filter_track import FilterTrack, HandOver
from spinfilters.models.process import ProcessNoise
from spinfilters.models.state_layout import Gaussian
from spinfilters.models.status import EstimatorStatus, Verdict
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import Scenario, simulate, without_map

Answers = list[tuple[Epoch, Gaussian]]


def scenario(epochs: int, seed: int) -> Scenario:
    """A body that stays in view, about 208 observations an epoch at 10 Hz."""
    noise = ProcessNoise(1e-12, 1e-6)
    return replace(Scenario.rich(seed), epochs=epochs, interval=0.1, velocity=(0.0, 0.0, 0.0), noise=noise)


def begun(setup: Setup, settings: Settings, name: str) -> Estimator:
    """A filter at the end of the initialisation."""
    entry = estimator_entries()[name]
    estimator = entry.build(setup, settings)
    assert estimator is not None
    entry.begin(estimator, setup)
    return estimator


def smoothed(setup: Setup, settings: Settings) -> list[HandOver]:
    """Smoother's hand-overs after every epoch behind the initialisation."""
    smoother = sliding_smoother(setup, settings)
    assert smoother is not None
    begin_after_initialisation(smoother, setup)
    options, now, given = replace(LandmarkOptions(), explained=0.0), setup.end_of_initialisation, []
    for epoch in setup.timeline[len(setup.initial.mean) :]:
        smoother.predict(epoch.time - now)
        smoother.update_all(epoch.measurements)
        now = epoch.time
        given.append(HandOver(now, smoother.sliding.joint_belief(options), str(smoother.status.verdict)))
    return given


def answers(
    setup: Setup, estimator: Estimator, given: list[HandOver], every: int, late: int
) -> tuple[Answers, list[int]]:
    """A filter's answers to all epochs, with hand-overs.

    The epochs right after a hand-over come with them.
    """
    track, said, fresh = FilterTrack(estimator, setup.end_of_initialisation), [], []
    for k, epoch in enumerate(setup.timeline[len(setup.initial.mean) :]):
        track.take(epoch)
        if every and k >= late and k % every == 0 and given[k - late].verdict == Verdict.OK:
            track.begin_rebase(
                given[k - late].time, lambda filter_, k=k: filter_.rebase(given[k - late].belief)
            )
            while not track.rebase_step():
                pass
            fresh.append(k)
        said.append((epoch, track.belief))
    return said, fresh


def figures(setup: Setup, said: Answers, chosen: list[int]) -> tuple[float, float, float]:
    """Rms position (m) and attitude (rad), and mean NEES.

    Per degree of freedom, of the chosen ones.
    """
    start, layout = setup.initial, setup.process.layout
    rows = GrowingHistory(layout, setup.timeline[0].time)
    for epoch, mean, factor in zip(setup.timeline, start.mean, start.factor, strict=False):
        rows.append(epoch.time, Gaussian(layout, mean, factor), [], 0.0)
    for epoch, belief in said:
        rows.append(epoch.time, belief, [], 0.0)
    history: EstimateHistory = rows.ended("filter", EstimatorStatus())
    found = evaluate(history, setup.dataset.truth, Alignment.FIRST_FRAME)
    assert found.errors is not None
    assert found.errors.position is not None
    assert found.nees is not None
    at = len(start.mean) + np.array(chosen)
    rms = [
        float(np.sqrt(np.square(rows[at]).sum(axis=1).mean()))
        for rows in (found.errors.position, found.errors.attitude)
    ]
    return rms[0], rms[1], float(np.mean(found.nees.total[at]) / layout.error_dim)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in (("seeds", 4), ("epochs", 130), ("every", 10), ("late", 10)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--filters", default="mekf,embedded")
    return parser.parse_args()


def main() -> None:
    """Run the study."""
    options = _options()
    found: dict[str, list[tuple[float, float, float]]] = {}
    for seed in range(options.seeds):
        settings = Settings()
        setup = prepare(without_map(simulate(scenario(options.epochs, seed))), settings)
        given = smoothed(setup, settings)
        timeline = setup.timeline[len(setup.initial.mean) :]
        states = [(epoch, each.state) for epoch, each in zip(timeline, given, strict=True)]
        every = list(range(options.late, len(states)))
        for name in options.filters.split(","):
            alone, _ = answers(setup, begun(setup, settings, name), given, 0, 0)
            stood, fresh = answers(setup, begun(setup, settings, name), given, options.every, options.late)
            at_once, again = answers(setup, begun(setup, settings, name), given, options.every, 0)
            for what, said, chosen in (
                (f"{name} alone", alone, every),
                (f"{name} with hand-overs", stood, every),
                (f"{name}, {options.late} epochs after what it stands on", stood, fresh),
                (f"{name}, at the epoch that it stands on", at_once, again),
                ("smoother", states, every),
                ("smoother, at the epochs that are handed over", states, again),
            ):
                found.setdefault(what, []).append(figures(setup, said, chosen))
        for what, rows in found.items():
            position, attitude, nees = np.mean(rows, axis=0)
            print(f"{seed} {what}: {1e3 * position:.3f} mm, {np.degrees(attitude):.4f} deg, NEES {nees:.2f}")


if __name__ == "__main__":
    run_study(main)
