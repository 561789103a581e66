"""The command ``fuse``: one inertia of several runs."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from spinfilters import compare, simulate
from spinfilters.cli.main import main
from tests.cli.faults import refusal

pytestmark = pytest.mark.usefixtures("few_figures")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Two runs of one body in motions that wobble."""
    folder, found = tmp_path_factory.mktemp("fused"), []
    for seed, rate in enumerate([(6.0, 1.0, 5.0), (2.0, 3.0, -8.0)]):
        place = folder / str(seed)
        compare(
            simulate(kind="pose", rate_rpm=rate, frames=60, seed=seed),
            estimators="smoother",
            output=place,
            no_figures=True,
        )
        found.append(str(place))
    return found


def test_runs_of_one_body_determine_its_inertia_better_together(runs: list[str], tmp_path: Path) -> None:
    stds = []
    for more in ([], ["--same-axes"]):
        assert main(["fuse", *runs, *more, "-o", str(tmp_path / "out")]) == 0
        found = json.loads((tmp_path / "out/fused.json").read_text())
        stds.append(np.array(found["principal_moments_std"][:2]))
        for each in found["runs"].values():
            assert (stds[-1] < np.array(each["principal_moments_std"][:2])).all()
        off = np.array(found["principal_moments"][:2]) - [0.8327843, 0.9688045]
        assert (np.abs(off) < 4 * stds[-1]).all()
    assert (stds[1] < stds[0]).all()
    inertia = tomllib.loads((tmp_path / "out/inertia.toml").read_text())
    assert np.shape(inertia["principal_axes_g"]) == (3, 3)


def test_runs_that_cannot_be_fused_are_refused_in_one_line(
    runs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "out")]
    assert "two or more runs" in refusal(capsys, "fuse", runs[0], *out)
    assert "stands twice" in refusal(capsys, "fuse", runs[0], f"{runs[0]}/smoother", *out)
    tracks = tmp_path / "tracks"
    compare(
        simulate(kind="stereo-tracks", frames=20),
        estimators="mekf",
        verdict="filter",
        output=tracks,
        no_figures=True,
    )
    assert "without --same-axes" in refusal(capsys, "fuse", str(tracks), *runs, "--same-axes", *out)
