"""Recordings and runs that several tests of commands share; none of them may change one."""

import pickle
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from spinfilters.cli.main import main
from spinfilters.io.dataset import Dataset
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.plots import figures
from spinfilters.run import comparison_run, preparation, smoother_convergence
from spinfilters.run.preparation import Setup
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate


@pytest.fixture
def few_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the figures that every run has: they take most of its time and have their own tests."""
    monkeypatch.setattr(figures, "_figures", lambda _: ())


@pytest.fixture(scope="session")
def prepared() -> dict[bytes, Setup]:
    """What runs began from, by a digest of recording and settings."""
    return {}


@pytest.fixture
def prepared_once(prepared: dict[bytes, Setup], monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs on one recording with the same settings begin from one initialisation: it takes most of a short run's time."""

    def prepare(dataset: Dataset, settings: Settings) -> Setup:
        digest = sha256(pickle.dumps((dataset, settings))).digest()
        if digest not in prepared:
            prepared[digest] = preparation.prepare(dataset, settings)
        return prepared[digest]

    monkeypatch.setattr(comparison_run, "prepare", prepare)


@pytest.fixture
def few_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compose no figure of all solves beside `convergence.png`: `test_optional_outputs` looks at those of `unmapped`."""
    for name in ("surfaces_figure", "constants_figure", "costs_figure"):
        monkeypatch.setattr(smoother_convergence, name, lambda *_: Figure())
    monkeypatch.setattr(smoother_convergence, "course_animation", lambda *_: b"")


@pytest.fixture(scope="session")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small simulated data set of every kind, by name of the kind."""
    folder = tmp_path_factory.mktemp("originals")
    for kind in ("stereo-tracks", "pose", "gyro"):
        write_dataset(
            simulate(Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=12, landmarks=40)),
            folder / kind,
        )
    return folder


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tracks without a map, the same with it, and a gyro."""
    folder = tmp_path_factory.mktemp("recordings")
    for kind in ("stereo-tracks", "gyro"):
        scenario = Scenario.simplified(kind=kind, rate_rpm=RICH_RPM, epochs=30, interval=0.5, landmarks=150)
        write_dataset(simulate(scenario), folder / kind)
    write_dataset(
        simulate(Scenario.simplified(rate_rpm=RICH_RPM, epochs=20, interval=0.5, landmarks=150)),
        folder / "unmapped",
    )
    (folder / "unmapped" / "landmarks.csv").unlink()
    return folder


@pytest.fixture(scope="session")
def unmapped(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on tracks without a map, with both additions."""
    run = tmp_path_factory.mktemp("unmapped") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "_figures", lambda _: ())
        asked = ["--estimators", "mekf,smoother", "--verdict", "filter", "--predict", "5", "--convergence"]
        arguments = [*asked, "-o", str(run)]
        assert main(["compare", str(recordings / "unmapped"), *arguments]) == 0
    return run


@pytest.fixture(scope="session")
def poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """20 frames of poses."""
    folder = tmp_path_factory.mktemp("failing") / "poses"
    write_dataset(simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=20)), folder)
    return folder


@pytest.fixture(scope="session")
def tracks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tracks without a map."""
    folder = tmp_path_factory.mktemp("failing") / "tracks"
    dataset = simulate(Scenario.simplified(rate_rpm=RICH_RPM, epochs=20, landmarks=80))
    write_dataset(replace(dataset, known_map=None), folder)
    return folder
