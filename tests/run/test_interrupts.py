"""Ctrl-C while a filter runs for something else than its own result: the command ends, nothing is decided on a part."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import spinfilters
from spinfilters.cli.main import main
from spinfilters.filters import timeline as loop
from spinfilters.inference import first_epochs as initialisation_length
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.run.estimation import compare_estimators
from spinfilters.run.preparation import prepare
from spinfilters.settings.run_settings import Settings
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.verdict import calibration_errors
from spinfilters.verdict import filter_diagnostics as inertia_evidence

EPOCHS = (1, 4)
"""Of a filter at which Ctrl-C comes: before there is any estimate, and in the middle."""
MODULES = (initialisation_length, inertia_evidence, calibration_errors)
"""Whose filters' results are no user's."""


@cache
def dataset() -> spinfilters.Dataset:
    """A gyro whose first epochs leave the moments vague enough that a filter is tried."""
    return simulate(Scenario.simplified(kind="gyro", rate_rpm=RICH_RPM, epochs=60, interval=0.2))


class Presser:
    """Ctrl-C at an epoch of the first filter of a module."""

    def __init__(self, module: ModuleType, epoch: int, patch: pytest.MonkeyPatch) -> None:
        self.module, self.epoch, self.done, self.is_within = module, epoch, 0, False
        taken, run = loop._take_in_epoch, module.run
        patch.setattr(loop, "MOST_TOGETHER", 0)  # so that every epoch comes by itself
        patch.setattr(loop, "_take_in_epoch", lambda *arguments: self._take_in_epoch(taken, *arguments))
        patch.setattr(module, "run", lambda *arguments: self._run(run, *arguments))

    @property
    def was_pressed(self) -> bool:
        """Whether its epoch came."""
        return self.done >= self.epoch

    def _take_in_epoch(self, taken: Callable[..., bool], *arguments: Any) -> bool:
        if self.is_within:
            self.done += 1
            if self.done == self.epoch:
                raise KeyboardInterrupt
        return taken(*arguments)

    def _run(self, run: Callable[..., Any], *arguments: Any) -> Any:
        self.is_within = True
        try:
            return run(*arguments)
        finally:
            self.is_within = False


def name_of(case: tuple[ModuleType, int]) -> str:
    """The module's, and the epoch."""
    return f"{case[0].__name__.rsplit('.', 1)[1]} {case[1]}"


@pytest.fixture(params=[(module, epoch) for module in MODULES for epoch in EPOCHS], ids=name_of)
def presser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Presser]:
    """Of each of the modules, at each of the epochs."""
    module, epoch = request.param
    found = Presser(module, epoch, monkeypatch)
    yield found
    assert found.was_pressed


def test_python_is_interrupted(presser: Presser) -> None:
    with pytest.raises(KeyboardInterrupt):
        spinfilters.compare(dataset(), "mekf", settings={"calibration": {"clock_scale_std": 0.01}})


def test_ctrl_c_behind_the_last_epoch_ends_the_run() -> None:
    """A filter takes in all epochs of a short recording in one call, behind which Ctrl-C comes."""

    def press(name: str, done: int, every: int) -> None:
        """Ctrl-C when the first estimator has taken in all."""
        if name == "mekf" and done == every:
            raise KeyboardInterrupt

    settings = Settings(estimators=("mekf", "smoother"))
    comparison = compare_estimators(prepare(dataset(), settings), settings, press)
    assert comparison.interrupted
    assert [each.name for each in comparison.evaluations] == ["mekf"]


@pytest.mark.parametrize("presser", [(module, 4) for module in MODULES], ids=name_of, indirect=True)
def test_the_command_ends_in_one_line_and_writes_no_results(
    presser: Presser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, config, run = (tmp_path / name for name in ("data", "mine.toml", "run"))
    write_dataset(dataset(), data)
    config.write_text("[calibration]\nclock_scale_std = 0.01\n")
    arguments = ["compare", str(data), "--config", str(config), "--estimators", "mekf", "-o", str(run)]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert presser.was_pressed
    assert len(said.splitlines()) == 1
    assert "interrupted" in said
    assert not list(run.glob("*.png"))
    assert run.exists() is (presser.module is not initialisation_length)  # before which nothing is to be kept
