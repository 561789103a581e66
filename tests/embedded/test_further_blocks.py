"""The C filter with a bias of the gyro, which may walk, and with a constant acceleration."""

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from spinfilters.core.c_library import compiler
from spinfilters.core.errors import InputError
from spinfilters.embedded.embedded_estimator import EmbeddedFilter
from spinfilters.embedded.embedded_options import EmbedOptions, Real
from spinfilters.embedded.folder import STD, example_start, folder_texts
from spinfilters.embedded.library import library_texts
from spinfilters.filters.ekf import MultiplicativeEkf
from spinfilters.filters.estimator import Measurement
from spinfilters.filters.iterated_update import IterationOptions
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.process import ProcessNoise, TorqueFreeProcess
from spinfilters.models.state_layout import Gaussian

needs_compiler = pytest.mark.skipif(compiler() is None, reason="the embedded filter is C; no compiler")
INTERVAL = 0.1
WOBBLE = (0.5, 0.8, 0.6)
"""Rate in rad/s, far from a steady spin, which would not determine a bias along its axis."""
BIASED = EmbedOptions("gyro", real="double", substeps=4, gyro_bias_std=0.02)
PULLED = EmbedOptions("pose", real="double", substeps=4, acceleration=True)


MASS_STD = 0.02
"""Of the mass distribution, as after a run on the ground: from a vague one an EKF of a gyro and its bias is over-confident."""


class Pair:
    """The C filter and the Python MEKF of the same options, from the same belief about a true motion.

    The MEKF's bias is constant; its walk is added to its belief after each prediction.
    """

    def __init__(self, options: EmbedOptions, seed: int) -> None:
        self.layout, self.rng = options.layout, np.random.default_rng(seed)
        self.process = TorqueFreeProcess(self.layout, ProcessNoise(1e-6, 1e-6))
        self.sensor, self.walk = options.emitted[0], options.gyro_bias_psd
        start = example_start(options)
        std = np.sqrt(np.diag(start.covariance))
        std[self.layout.slice("s")] = MASS_STD
        self.truth = start.mean.copy()
        self.truth[self.layout.mean_slice("w")] = WOBBLE
        mean = self.layout.retract(self.truth, std * self.rng.normal(size=len(std)))
        self.ours = EmbeddedFilter(self.process, options)
        self.theirs = MultiplicativeEkf(self.process, iteration=IterationOptions(iterations=1))
        self.model: MeasurementModel = self.sensor.model(self.layout)
        for estimator in (self.ours, self.theirs):
            estimator.start(Gaussian(self.layout, mean, np.diag(std)))

    def run(self, epochs: int, estimators: Sequence[EmbeddedFilter | MultiplicativeEkf] = ()) -> None:
        """Predict and update both, or these alone, with the same noisy values of the true motion."""
        assert self.sensor.example is not None
        model = self.model
        for _ in range(epochs):
            self.truth = self.process.step(self.truth, INTERVAL)
            exact = model.predict(self.truth, self.sensor.example)
            noise = np.array(self.sensor.example_std) * self.rng.normal(size=len(exact))
            value = self.sensor.normalised(exact + noise)
            for estimator in estimators or (self.ours, self.theirs):
                estimator.predict(INTERVAL)
                if self.walk and estimator is self.theirs:
                    self._walk()
                estimator.update(Measurement(model, value[None], self.sensor.example[None]))

    def _walk(self) -> None:
        belief = self.theirs.belief
        covariance = belief.covariance.copy()
        bias = self.layout.slice("b")
        covariance[bias, bias] += self.walk * INTERVAL * np.eye(3)
        self.theirs.start(Gaussian(self.layout, belief.mean, np.linalg.cholesky(covariance)))

    @property
    def departure(self) -> float:
        """Largest difference of means in standard deviations, and of covariances as correlations."""
        a, b = self.theirs.belief, self.ours.belief
        means = np.abs(self.layout.local(a.mean, b.mean) / a.std).max()
        return float(max(means, np.abs((b.covariance - a.covariance) / np.outer(a.std, a.std)).max()))

    def error(self, block: str) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Error of a block of the C filter in its standard deviations, and these."""
        belief, at = self.ours.belief, self.layout.slice(block)
        return self.layout.local(self.truth, belief.mean)[at] / belief.std[at], belief.std[at]


@needs_compiler
@pytest.mark.parametrize(
    ("options", "bound"),
    [(BIASED, 1e-9), (replace(BIASED, gyro_bias_psd=1e-8), 1e-8), (PULLED, 1e-9)],
)
def test_in_double_it_is_the_python_filter_with_the_same_block(options: EmbedOptions, bound: float) -> None:
    """A walk squares and factors the covariance of the Python filter again in each step, which costs it digits."""
    pair = Pair(options, 3)
    pair.run(100)
    assert pair.departure < bound


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bias_and_acceleration_are_found_within_their_deviations(real: Real, seed: int) -> None:
    vague = replace(BIASED, gyro_bias_std=0.05)
    for options, block, prior in ((vague, "b", 0.05), (PULLED, "f", STD["f"])):
        pair = Pair(replace(options, real=real), seed)
        pair.run(300, [pair.ours])
        error, std = pair.error(block)
        assert np.abs(error).max() < 4
        assert std.max() < prior / 2


@needs_compiler
def test_a_bias_that_walks_never_becomes_certain() -> None:
    """Its variance grows by the density times the time, to rounding, while nothing is measured."""
    options = replace(BIASED, gyro_bias_psd=1e-6)
    pair = Pair(options, 1)
    pair.run(20)
    at = options.layout.slice("b")
    before = pair.ours.belief.covariance[at, at]
    for _ in range(50):
        pair.ours.predict(INTERVAL)
    after = pair.ours.belief.covariance[at, at]
    np.testing.assert_allclose(after - before, 1e-6 * 50 * INTERVAL * np.eye(3), atol=1e-14)


def test_only_a_walk_changes_the_fixed_sources() -> None:
    plain, biased = (library_texts(each) for each in (replace(BIASED, gyro_bias_std=0.0), BIASED))
    walking = library_texts(replace(BIASED, gyro_bias_psd=1e-8))
    for name, text in plain.items():
        assert "SF_GYRO_BIAS_PSD" not in text
        if name not in ("spinfilter_config.h", "spinfilter_model.c"):
            assert text == biased[name]
            assert (text == walking[name]) == (name != "spinfilter_predict.c")


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(
    "options",
    [
        EmbedOptions("gyro", gyro_bias_std=0.01, gyro_bias_psd=1e-8),
        EmbedOptions("pose", acceleration=True),
    ],
)
def test_strict_c_without_undefined_behaviour_agrees_with_the_vectors(
    tmp_path: Path, options: EmbedOptions
) -> None:
    for name, text in folder_texts(options).items():
        (tmp_path / name).write_text(text)
    sources = sorted(path.name for path in tmp_path.glob("spinfilter_*.c"))
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fno-sanitize-recover=all"]
    flags += ["-fsanitize=address,undefined"]
    for program in ("test_spinfilter", "main"):
        command = ["cc", *flags, "-o", program, f"{program}.c", *sources, "-lm"]
        built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        if "cannot find" in built.stderr:
            pytest.skip("the compiler has no sanitizers")
        assert built.returncode == 0, built.stderr
        done = subprocess.run([f"./{program}"], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("wrong", "cure"),
    [
        ({"sensor": "pose", "gyro_bias_std": 0.01}, "needs --sensor gyro"),
        ({"sensor": "gyro", "acceleration": True}, "needs --sensor pose or stereo"),
        ({"sensor": "gyro", "gyro_bias_psd": 1e-8}, "give --gyro-bias-std too"),
        ({"sensor": "gyro", "gyro_bias_std": -1.0}, "give 0 or a number from"),
    ],
)
def test_a_block_that_the_sensor_says_nothing_of_is_refused(wrong: dict, cure: str) -> None:
    with pytest.raises(InputError, match=cure):
        EmbedOptions(**wrong)
