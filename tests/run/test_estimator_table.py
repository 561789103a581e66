"""The table of estimators: one file each; one from outside the package joins comparisons."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from spinfilters import compare, simulate
from spinfilters.cli.commands.compare import NAMES
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.core.plugins import installed_plugins
from spinfilters.run.estimators import estimator_entries
from spinfilters.run.run_summary import read_summary
from spinfilters.settings.run_settings import DEFAULT_ESTIMATORS, Settings, estimator_names

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "add-an-estimator.md"
PROGRAM = re.findall(r"^```python\n(.*?)^```", HOW_TO.read_text(), re.MULTILINE | re.DOTALL)[0]


@pytest.fixture
def distribution(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installed distribution with the module of the how-to page, on the path."""
    information = tmp_path / "site" / "open_loop-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: open-loop\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(
        "[spinfilters.estimators]\nopen-loop = open_loop:ESTIMATOR\n"
    )
    (information.parent / "open_loop.py").write_text(PROGRAM)
    monkeypatch.syspath_prepend(str(information.parent))
    installed_plugins.cache_clear()
    yield information
    monkeypatch.undo()
    sys.modules.pop("open_loop", None)
    installed_plugins.cache_clear()


def test_the_table_is_in_its_order_and_begins_with_the_defaults() -> None:
    entries = estimator_entries()
    assert tuple(entries) == estimator_names()
    assert tuple(entries)[: len(DEFAULT_ESTIMATORS)] == DEFAULT_ESTIMATORS
    orders = [entry.order for entry in entries.values()]
    assert orders == sorted(orders)


def test_the_help_names_every_estimator() -> None:
    assert sorted(NAMES.split(", ")) == sorted(estimator_names())


@pytest.mark.usefixtures("distribution")
@pytest.mark.usefixtures("unrendered")
def test_an_estimator_from_outside_is_compared_interrupted_and_resumed(tmp_path: Path) -> None:
    data, run = str(tmp_path / "data"), tmp_path / "run"
    assert main(["simulate", "-o", data, "--kind", "gyro", "--rate-rpm", "4", "9", "3"]) == 0
    assert main(["compare", data, "-o", str(run), "--estimators", "mekf,open-loop"]) == 0
    estimators = read_summary(run)["estimators"]
    assert list(estimators) == ["mekf", "open-loop"]
    assert estimators["mekf"]["status"] == "ok"
    counts = estimators["open-loop"]["measurements"]
    assert counts["accepted"] == 0 < counts["rejected"]
    assert (run / "open-loop" / "trajectory.csv").is_file()
    assert main(["compare", data, "-o", str(run), "--estimators", "mekf,open-loop", "--resume"]) == 0
    assert read_summary(run)["estimators"]["open-loop"]["measurements"] == counts


def test_an_estimator_that_is_not_installed_is_refused_with_the_names_of_all() -> None:
    with pytest.raises(InputError, match=r"open-loop.*choose from mekf, ukf, smoother, filterpy-ekf"):
        Settings(estimators=("open-loop",))


def test_a_name_that_stands_twice_is_refused(distribution: Path) -> None:
    module = distribution.parent / "open_loop.py"
    module.write_text(
        PROGRAM.replace('    name = "open-loop"\n    is_base', '    name = "mekf"\n    is_base')
    )
    sys.modules.pop("open_loop", None)
    installed_plugins.cache_clear()
    with pytest.raises(InputError, match="'mekf' is registered twice"):
        estimator_entries()


@pytest.mark.parametrize("kind", ["pose", "gyro"])
def test_every_member_of_the_family_estimates_the_same_recording(kind: str) -> None:
    names = ("mekf", "iekf", "rts", "invariant", "ekf-joint", "smoother", "smoother-lag-5")
    run = compare(simulate(kind, frames=60), names)
    errors = {name: run.summary["estimators"][name]["errors"] for name in names}
    assert all(each["nees_per_dof"] < 4 for each in errors.values())
    rates = {name: each["rms_rate_rad_s"] for name, each in errors.items()}
    for name in ("iekf", "invariant", "ekf-joint"):
        assert rates[name] == pytest.approx(rates["mekf"], rel=0.2)
    assert rates["rts"] < rates["mekf"]
    assert not any(
        each["name"] == "filter-disturbance" for each in run.summary["estimators"]["rts"]["checks"]
    )


def test_an_epoch_that_leaves_before_the_inertia_is_known_carries_no_more_than_was_measured() -> None:
    """On a flipping body the estimate moves by half its size after epochs have left; their NEES was 500."""
    names = ("smoother-lag-1", "smoother-lag-10")
    run = compare(simulate("pose", frames=100, rate_rpm=(0.5, 10.0, 0.5)), names, verdict="filter")
    for name in names:
        assert run.summary["estimators"][name]["errors"]["nees_per_dof"] < 3


def test_a_fixed_lag_that_forgot_a_curved_belief_is_called_over_confident() -> None:
    run = compare(simulate("pose", seed=3, frames=100, rate_rpm=(0.5, 10.0, 0.5)), "smoother-lag-10")
    checks = [each["name"] for each in run.summary["estimators"]["smoother-lag-10"]["checks"]]
    assert "over-confident" in checks
