"""Settings files and run folders of before still read."""

import pytest

from spinfilters.core.errors import InputError
from spinfilters.settings.run_settings import settings_from


def test_former_tables_and_keys_are_read() -> None:
    former = {
        "start": {"frames": 30},
        "smoother": {"frames": 90, "kernel": "huber"},
        "robust": {"kernel": "huber"},
    }
    settings = settings_from(former, "test")
    assert settings.initialisation.epochs == 30
    assert (settings.smoother.epochs, settings.smoother.loss, settings.robust.loss) == (90, "huber", "huber")


def test_a_setting_under_both_names_is_refused() -> None:
    with pytest.raises(InputError, match=r"test: smoother\.kernel and smoother\.loss are one setting"):
        settings_from({"smoother": {"kernel": "huber", "loss": "gate"}}, "test")
