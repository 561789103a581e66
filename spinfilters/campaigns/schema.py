"""Columns of a campaign's rows: factors, results, cost."""

from typing import Final

import pyarrow as pa

from spinfilters.state.quantities import QUANTITIES

ERRORS: Final = ("position_m", "attitude_rad", "velocity_m_s", "rate_rad_s")
"""Root mean square over the estimator's own epochs, and at the last one."""
BODY_ERRORS: Final = ("moment_1", "moment_2", "k1", "k2", "center_of_mass_m")
"""At the last epoch; moments relative to the largest."""
BLOCKS: Final = ("t", "a", "v", "w", "c", "s")
"""Of the state, whose NEES per degree of freedom is kept."""
LEVELS: Final = (
    "pixel_std",
    "pose_position_std",
    "pose_rotation_std",
    "gyro_noise_std",
    "attitude_std",
    "lidar_position_std",
    "lidar_rotation_std",
    "lidar_range_std",
    "lidar_angle_std",
    "force_psd",
    "torque_psd",
)
"""Of noise: true, as identified (absent where it is stated), and the deviation of its ln variance."""
TIMES: Final[tuple[str, ...]] = ("simulate", "initialise", "estimate", "evaluate")
"""Seconds of processor time of one run's parts."""
OUTCOMES: Final = ("done", "refused", "raised", "timeout", "killed")
"""How a run ended: "refused" by a message to the user, "raised" by an unexpected error, "timeout" by its own time limit,
"killed" by a signal, as from the system's memory killer."""
MOST_EPOCHS: Final = 60
"""Epochs of which NEES is kept, at most; of longer runs some."""
VOLATILE: Final = ("time_", "host", "finished")
"""How columns begin that depend on when and where a run was made."""

_TEXT, _WHOLE, _NUMBER = pa.string(), pa.int64(), pa.float64()
_FIXED: Final[tuple[tuple[str, pa.DataType], ...]] = (
    ("outcome", _TEXT),
    ("reason", _TEXT),
    ("verdict", _TEXT),
    ("verdict_reasons", _TEXT),
    ("verdict_checks", _TEXT),
    *((f"holds_{name}", _TEXT) for name in QUANTITIES),
    ("model_errors", _TEXT),
    ("right", pa.bool_()),
    ("worst_error", _NUMBER),
    ("worst_quantity", _TEXT),
    ("epochs", _WHOLE),
    ("accepted", _WHOLE),
    ("rejected", _WHOLE),
    ("nis", _NUMBER),
    ("dof", _WHOLE),
    ("nees", _NUMBER),
    ("nees_last", _NUMBER),
    *((f"nees_{block}", _NUMBER) for block in BLOCKS),
    *((f"error_{name}", _NUMBER) for name in ERRORS),
    *((f"last_{name}", _NUMBER) for name in ERRORS),
    *((f"error_{name}", _NUMBER) for name in BODY_ERRORS),
    *((f"std_{name}", _NUMBER) for name in BODY_ERRORS[:4]),
    *((f"bound_{name}", _NUMBER) for name in (*ERRORS, *BODY_ERRORS)),
    *((f"true_{name}", _NUMBER) for name in LEVELS),
    *((f"found_{name}", _NUMBER) for name in LEVELS),
    *((f"log_std_{name}", _NUMBER) for name in LEVELS),
    ("nees_time_s", pa.list_(pa.float32())),
    ("nees_over_time", pa.list_(pa.float32())),
    ("version", _TEXT),
    ("packages", _TEXT),
    *((f"time_{name}_s", _NUMBER) for name in TIMES),
    ("time_total_s", _NUMBER),
    ("finished", _TEXT),
    ("host", _TEXT),
)


def schema(factors: list[str]) -> pa.Schema:
    """Schema of the rows of a study with these factors.

    ``run``, ``cell``, ``seed``; a column of text per factor; then what came out. NEES are per degree of freedom, means over the
    estimator's own epochs; errors are lengths; ``bound_`` stands in the place of ``error_``.
    """
    asked = [("run", _WHOLE), ("cell", _WHOLE), ("seed", _WHOLE), *((name, _TEXT) for name in factors)]
    return pa.schema([*asked, *_FIXED])


def is_volatile(column: str) -> bool:
    """Whether a column differs when a run is repeated."""
    return column.startswith(VOLATILE)
