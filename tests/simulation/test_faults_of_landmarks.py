"""What faults of landmarks do to a recording."""

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.simulation.measurement_faults import FewAtFirst, NewIds, with_faults
from spinfilters.simulation.scenario import Scenario, simulate

RECORDING = simulate(Scenario.simplified(epochs=20, landmarks=100))


def _ids(dataset: Dataset, begin: float, end: float) -> set[int]:
    stream = dataset.log.stream("stereo")
    assert stream.ids is not None
    return set(stream.ids[(stream.time >= begin) & (stream.time < end)].tolist())


def test_new_ids_are_new_and_end_when_told() -> None:
    faulty = with_faults(RECORDING, (NewIds(4.0, 6.0),), 0)
    assert not _ids(faulty, 4.0, 6.0) & (_ids(faulty, 0.0, 4.0) | _ids(faulty, 6.0, np.inf))
    assert _ids(faulty, 6.0, np.inf) == _ids(RECORDING, 6.0, np.inf)


def test_few_at_first_are_all_afterwards() -> None:
    faulty = with_faults(RECORDING, (FewAtFirst(0.2, 5.0),), 0)
    assert 0 < len(_ids(faulty, 0.0, 5.0)) <= 20
    assert _ids(faulty, 5.0, np.inf) == _ids(RECORDING, 5.0, np.inf)


@pytest.mark.parametrize(
    ("kind", "values", "text"),
    [
        (NewIds, (6.0, 4.0), "6.0 s to 4.0 s"),
        (FewAtFirst, (0.0, 4.0), "0.0"),
        (FewAtFirst, (1.5, 4.0), "1.5"),
    ],
)
def test_faults_that_cannot_be_are_refused(kind, values, text) -> None:
    with pytest.raises(InputError, match=text):
        kind(*values)
