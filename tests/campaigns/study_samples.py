"""Small studies that several tests of campaigns share."""

from typing import Any

from spinfilters.campaigns.study import Study, study_from

GYRO: dict[str, Any] = {
    "study": {"name": "gyros", "seeds": 3, "bound": "none"},
    "factors": {"estimator": ["mekf", "ukf"], "motion": ["rich", "short"]},
    "motion": {"base": {"rate_rpm": [4.0, 9.0, 3.0], "epochs": 40}, "rich": {}, "short": {"epochs": 30}},
    "sensor": {"base": {"kind": "gyro"}},
}


def gyro_document(**options: Any) -> dict[str, Any]:
    """The document of quick runs, with other options, whose models are not tested."""
    return {**GYRO, "study": {**GYRO["study"], **options}, "settings": {"base": {"verdict": "filter"}}}


def gyro_study(**options: Any) -> Study:
    """Twelve runs of a hundredth of a second each."""
    return study_from(gyro_document(**options), "study")
