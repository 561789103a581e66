"""Segments of a body that an Xsens MVN tracks: its export as XML, .mvnx."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.io.dataset import Dataset
from spinfilters.io.document import read_xml
from spinfilters.io.input_file import path_text, printable, value_text
from spinfilters.io.motion_file import motion_dataset
from spinfilters.io.motion_table import motion_of
from spinfilters.io.named_columns import ArrayColumns
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions, to_state

_POSE_NAMES: Final = ("px", "py", "pz", "qw", "qx", "qy", "qz")


def read_mvnx(path: Path, options: ReadingOptions) -> Dataset:
    """Poses of the only segment, or of the one that the topic names: origin (m) and q_ib, scalar first, with the time in ms."""
    options.require_only(("topic",), "an Xsens MVN export")
    root = read_xml(path)
    labels = [each.get("label", "") for each in root.iter("segment")]
    frames = [each for each in root.iter("frame") if each.get("type") == "normal"]
    if not frames or not labels:
        raise InputError(
            f"{path_text(path)}: has no frames of segments; export orientation and position as MVNX"
        )
    place = _place(path, labels, options.topic)
    poses = np.column_stack(
        [_vectors(path, frames, name, len(labels), width)[:, place] for name, width in _PARTS]
    )
    clock = _vectors(path, frames, "", 1, 1)[:, 0]
    source = ArrayColumns(path, ("time_ms", *_POSE_NAMES), (*clock.T, *poses.T))
    described = f"{path.name}, {printable(labels[place])}"
    return motion_dataset(path, described, motion_of(source, NOTHING_STATED))


_PARTS: Final = (("position", 3), ("orientation", 4))


def _place(path: Path, labels: Sequence[str], wanted: str | None) -> int:
    """Number of the segment. InputError: several and none named, or no such one."""
    if wanted is None and len(labels) == 1:
        return 0
    if wanted is None or labels.count(wanted) != 1:
        listed = ", ".join(map(value_text, labels[:30]))
        raise InputError(
            f"{path_text(path)}: has the segments {listed}; choose one with {to_state('topic', 'NAME')}"
        )
    return labels.index(wanted)


def _vectors(
    path: Path, frames: Sequence[Element], name: str, segments: int, width: int
) -> Float[np.ndarray, "n k w"]:
    """Numbers of each frame: of the element of that name, by segment; of its time for an empty name. InputError: other numbers."""
    rows = np.empty((len(frames), segments, width))
    for row, frame in enumerate(frames):
        text = (frame.findtext(name) if name else frame.get("time")) or ""
        try:
            rows[row] = np.array(text.split(), dtype=np.float64).reshape(segments, width)
        except ValueError:
            raise InputError(
                f"{path_text(path)}: frame {row}: {name or 'time'} is not {segments} times {width} numbers; export orientation and "
                "position of all segments again"
            ) from None
    return rows
