"""The law of a drag is that of the likelier first epochs."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from spinfilters.models.state_blocks import DRAG, LINEAR_DRAG
from spinfilters.run.preparation import prepare
from spinfilters.run.readers import read_whole
from spinfilters.settings.run_settings import ProcessSettings, Settings

J = np.array([0.4, 0.75, 1.0])
LINEAR, QUADRATIC = 0.08, 0.04


def recording(folder: Path, linear: float, quadratic: float) -> Path:
    """A gyro's rates of a body that turns by Euler's equation with drag, integrated by SciPy."""

    def change(_: float, w: np.ndarray) -> np.ndarray:
        return np.cross(J * w, w) / J - (linear + quadratic * np.linalg.norm(w)) * w

    time = 0.1 * np.arange(120)
    options = {"t_eval": time, "rtol": 1e-9, "atol": 1e-11}
    rates = solve_ivp(change, (0.0, time[-1]), [0.6, 2.5, 0.8], **options).y.T
    rates += 0.004 * np.random.default_rng(1).standard_normal(rates.shape)
    path = folder / "gyro.csv"
    rows = np.column_stack([time, rates])
    np.savetxt(path, rows, delimiter=",", header="time_s,wx,wy,wz", comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize(
    ("linear", "quadratic", "block"),
    [(LINEAR, 0.0, LINEAR_DRAG), (0.0, QUADRATIC, DRAG), (0.0, 0.0, None)],
    ids=["linear", "quadratic", "none"],
)
def test_the_law_of_the_body_is_chosen_and_its_coefficient_found(
    tmp_path: Path, linear: float, quadratic: float, block: object
) -> None:
    setup = prepare(
        read_whole(recording(tmp_path, linear, quadratic)), Settings(process=ProcessSettings(drag="auto"))
    )
    held = [each for each in (DRAG, LINEAR_DRAG) if setup.process.layout.has(each)]
    assert held == ([] if block is None else [block])
    for each in held:
        belief, part = setup.initial.belief, setup.process.layout.mean_slice(each.name)
        std = belief.std[setup.process.layout.slice(each.name)]
        assert abs(belief.mean[part] - (linear + quadratic))[0] < 4 * std[0]
        assert std[0] < 0.2 * (linear + quadratic)
