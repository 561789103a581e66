"""A run as a recording of Rerun: read back, it has bodies, ellipsoids and courses of every estimator, and the truth."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.run.exported_runs import write_rrd


def test_a_run_saved_for_rerun_is_read_back(tmp_path: Path) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk of the extra rerun")
    data = spinfilters.simulate("pose", frames=20, seed=2)
    run = spinfilters.compare(data, ("mekf", "ukf"), settings={"verdict": "filter"})
    path = run.save(tmp_path / "run.rrd")
    assert [each.name for each in tmp_path.iterdir()] == ["run.rrd"]
    found = {each.entity_path: each for each in chunks.RrdReader(path).stream().to_chunks()}
    assert {"/i/truth/body", "/truth/rate", "/i/mekf/body/principal_axes", "/mekf/verdict"} <= set(found)
    for name in run:
        motion = run[name].evaluation.trajectory
        moved = found[f"/i/{name}/body"].to_record_batch().to_pydict()
        places = np.array(moved["Transform3D:translation"])[:, 0]
        np.testing.assert_allclose(places, motion.position, atol=1e-6)  # Rerun holds single precision
        spread = found[f"/i/{name}/position"].to_record_batch().to_pydict()
        half_axes = np.array(spread["Ellipsoids3D:half_sizes"])[:, 0]
        np.testing.assert_allclose(half_axes, 3 * motion.std_position, rtol=1e-6)
        nis = found[f"/{name}/nis"].to_record_batch().to_pydict()["Scalars:scalars"]
        np.testing.assert_allclose(np.array(nis)[:, 0], run[name].evaluation.history.nis, rtol=1e-12)


class StandIn:
    """As much of Rerun as a file is made with: it keeps what is logged, by entity and time. The package has 170 MB."""

    def __init__(self) -> None:
        self.logged: list[tuple[str, float | None, Any]] = []
        self.now: float | None = None

    def __getattr__(self, name: str) -> Any:
        """Every archetype keeps its arguments; ``columns`` of it too."""
        if name.startswith("__"):
            raise AttributeError(name)

        def made(*values: object, **named: object) -> tuple[str, tuple[object, ...], dict[str, object]]:
            return name, values, named

        made.columns = made  # pyright: ignore[reportFunctionMemberAccess]
        return SimpleNamespace(MARKDOWN="text/markdown", RDF="RDF") if name in CHOICES else made

    def RecordingStream(self, *_: object, **__: object) -> "StandIn":  # noqa: N802
        return self

    def save(self, path: str) -> None:
        Path(path).write_bytes(b"RRF2")

    def set_time(self, line: str, duration: float) -> None:
        assert line == "time"
        self.now = duration

    def log(self, entity: str, content: Any, static: bool = False) -> None:
        self.logged.append((entity, None if static else self.now, content))

    def send_columns(self, entity: str, indexes: Any, columns: Any) -> None:
        self.logged.append((entity, None, columns))

    def flush(self) -> None: ...

    def disconnect(self) -> None: ...


CHOICES = ("ViewCoordinates", "MediaType")
"""Names of Rerun that are lists of values."""


def test_images_of_the_left_camera_stand_on_the_time_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rerun = StandIn()
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    for camera in ("cam0", "cam1"):
        (tmp_path / camera / "data").mkdir(parents=True)
        for k in range(400):
            (tmp_path / camera / "data" / f"{1_000_000_000 + k * 50_000_000}.png").write_bytes(
                b"\x89PNG" + bytes([k % 256])
            )
    write_rrd(tmp_path / "run.rrd", [], {}, "images", tmp_path)
    assert (tmp_path / "run.rrd").read_bytes() == b"RRF2"
    found = [(time, content) for entity, time, content in rerun.logged if entity == "camera/left"]
    assert len(found) == 200
    assert [time for time, _ in found[:2]] == [0.0, 0.1]
    assert found[1][1] == ("EncodedImage", (), {"contents": b"\x89PNG\x02", "media_type": "image/png"})


def test_without_rerun_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    run = spinfilters.compare(
        spinfilters.simulate("gyro", frames=20, seed=2), ("mekf",), settings={"verdict": "filter"}
    )
    with pytest.raises(ImportError, match=r"pip install 'spinfilters\[rerun\]'"):
        run.save(tmp_path / "run.rrd")
    assert list(tmp_path.iterdir()) == []
