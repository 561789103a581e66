"""A spin about one axis does not tell which slow error its gyro or motion has."""

import numpy as np
import pytest
from jaxtyping import Float
from plain_comparison import plain_comparison

from spinfilters.io.consider_parameter import exact_calibration
from spinfilters.io.dataset import Dataset, DatasetOptions
from spinfilters.io.measurement_log import MeasurementLog, MeasurementStream
from spinfilters.settings.run_settings import Settings
from spinfilters.verdict import model_tests as model_errors
from spinfilters.verdict import tested_models
from spinfilters.verdict.tested_models import NO_CORRELATION, model_findings

SAMPLES, NOISE = 120, 1e-3
AXIS = np.array([0.2, -0.97, 0.1])


def models_of(
    change: Float[np.ndarray, "k 3"], monkeypatch: pytest.MonkeyPatch
) -> tested_models.TestedModels:
    """Tests of a gyro of a steady spin that reads this change of its rates, and noise."""
    monkeypatch.setattr(model_errors, "possible_correlation", lambda *_: NO_CORRELATION)
    noise = NOISE * np.random.default_rng(4).standard_normal((SAMPLES, 3))
    stream = MeasurementStream("gyro", np.arange(SAMPLES, dtype=float), AXIS + change + noise)
    exact = exact_calibration(("gyro",))
    options = DatasetOptions(calibration=exact, gyro_noise_std=NOISE, torque_psd=1e-12)
    settings = Settings(estimators=("smoother",))
    dataset = Dataset(kind="gyro", log=MeasurementLog((stream,)), options=options)
    return plain_comparison(dataset, settings).models


def test_a_slow_change_is_given_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    models = models_of(2e-3 * np.linspace(-1, 1, SAMPLES)[:, None] * AXIS, monkeypatch)
    assert models.names == ("slow-change",)
    assert not models.named
    assert "a spin about one axis cannot distinguish" in model_findings(models, None)[0].reason


def test_a_sudden_change_is_named_as_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    last = np.clip((np.arange(SAMPLES) - 0.95 * SAMPLES) / (0.05 * SAMPLES), 0, None)
    models = models_of(-0.05 * last[:, None] * AXIS, monkeypatch)
    assert models.named[0].error.name == "contact-at-end"
