"""All readers of recordings, all front ends of raw data, and who reads a path.

A reader says here how a path of its format is known and what it is called. What reads the format is a file of `spinfilters.io`,
which is imported when a path is of it, or may be.
"""

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Final

from spinfilters.core.errors import InputError
from spinfilters.core.plugins import entries_by_name, in_order, installed_plugins, require_made
from spinfilters.io.dataset import DATASET_FILE, PHYPHOX_TABLE, Dataset
from spinfilters.io.dataset_folder import read_folder, read_sensor_table, undescribed_folder
from spinfilters.io.dataset_reader import (
    DatasetReader,
    OnRefused,
    RawDataReader,
    StatedReader,
    is_file_named,
)
from spinfilters.io.input_file import first_text, path_text, require_folder
from spinfilters.io.measurement_log import MeasurementLog
from spinfilters.io.repeated_rows import without_repeated_rows
from spinfilters.io.sensor_format import sensor_format, sensor_formats
from spinfilters.io.stated_values import NOTHING_STATED, ReadingOptions


def without_rows_logged_again(dataset: Dataset) -> Dataset:
    """The data set without rows that only repeat the row before; its description says how many."""
    streams, remarks = [], []
    for stream in dataset.log.streams:
        kept, remark = without_repeated_rows(stream)
        streams.append(kept)
        remarks += [remark] if remark else []
    if not remarks:
        return dataset
    description = "; ".join(words for words in (dataset.description, *remarks) if words)
    return replace(dataset, log=MeasurementLog(tuple(streams)), description=description)


def front_ends() -> tuple[RawDataReader, ...]:
    """All makers of measurements from raw data: ours, and those of the entry points ``spinfilters.front_ends``.

    Stereo images are not among them: following their features has options of its own (`spinfilters.vision.track_images`).

    Raises
    ------
    InputError
        As `installed_plugins`.
    """
    from spinfilters.lidar.scan_streams import (  # slow to import, and few recordings are scans
        SCAN_POINTS,
        SCANS,
    )

    return (SCAN_POINTS, SCANS, *installed_plugins("spinfilters.front_ends", RawDataReader))


def front_end_of(kind: str) -> RawDataReader | None:
    """The maker of measurements from raw data of a kind, or None."""
    return next((each for each in front_ends() if each.kind == kind), None)


def dataset_readers() -> list[DatasetReader]:
    """All readers, in the order they are asked: ours, and those of the entry points ``spinfilters.readers``.

    InputError: a plug-in that cannot be loaded, a name that stands twice.
    """
    every = (*OWN_READERS, *installed_plugins("spinfilters.readers", DatasetReader))
    return list(entries_by_name(in_order(every), "reader").values())


def reader_of(path: Path, options: ReadingOptions = NOTHING_STATED) -> DatasetReader:
    """First reader that recognises a path; the last takes any. InputError: `DatasetReader.stating`."""
    reader = next(reader for reader in dataset_readers() if reader.recognises(path))
    return reader.stating(options) if options.stated else reader


def read_dataset(
    path: str | os.PathLike[str], segment: int | None = None, options: ReadingOptions = NOTHING_STATED
) -> Dataset:
    """The data set of a path, by the reader that recognises it.

    Parameters
    ----------
    path : str or os.PathLike
        Of the recording: a folder or a file.
    segment : int or None
        Number of a kept segment of a phyphox recording; None where there is only one.
    options : ReadingOptions
        What its user states of the recording.

    Raises
    ------
    InputError
        An unusable file (see the readers), several segments and none chosen, a segment that is not a trial, a
        kind whose front end is not part of this version. The text names file, line or value, and the cure.
    """
    place = Path(path)
    reader = reader_of(place, options)
    _require_segments(reader, place, segment)
    return _check_dataset(reader, reader.read(place, segment))


def _require_segments(reader: DatasetReader, path: Path, segment: int | None) -> None:
    if segment is not None and not reader.has_segments:
        raise InputError(f"{path_text(path)}: has no segments; leave out --segment {segment}")


def read_whole(path: str | os.PathLike[str], options: ReadingOptions = NOTHING_STATED) -> Dataset:
    """The whole recording of a path, whatever segments are marked in it. Errors: `read_dataset`."""
    reader = reader_of(Path(path), options)
    return _check_dataset(reader, reader.whole(Path(path)))


def read_segments(
    path: str | os.PathLike[str],
    on_refused: OnRefused | None = None,
    options: ReadingOptions = NOTHING_STATED,
) -> list[Dataset]:
    """Every kept segment of a phyphox folder, else the one data set.

    Parameters
    ----------
    path : str or os.PathLike
        Of the recording.
    on_refused : OnRefused or None
        Called with the number of a segment that is no trial, and why, instead of raising InputError for it.
    options : ReadingOptions
        What its user states of the recording.

    Raises
    ------
    InputError
        As `read_dataset`.
    """
    reader = reader_of(Path(path), options)
    return [_check_dataset(reader, each) for each in reader.segments(Path(path), on_refused)]


def recordings_in(folder: Path) -> tuple[Path, ...]:
    """Recordings in a folder that is none itself, by name, which ``--segment auto`` takes together.

    Those of the commonest kind (data set folders and exports, or files of one suffix); none where there are not two.
    """
    if not os.path.isdir(folder) or _is_recording(folder):
        return ()
    by_kind: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if _is_recording(path):
            by_kind.setdefault("" if os.path.isdir(path) else path.suffix.lower(), []).append(path)
    found = max(by_kind.values(), key=len, default=[])
    return tuple(found) if len(found) > 1 else ()


def _is_recording(path: Path) -> bool:
    """Whether a path, by its name or its files, looks like a recording."""
    reader, anything = reader_of(path), dataset_readers()[-1]
    if os.path.isdir(path):
        return reader.order < OtherFolderReader.order
    suffixes = [suffix for form in sensor_formats().values() for suffix in form.suffixes]
    return reader.name != anything.name or path.suffix.lower() in suffixes


def _check_dataset(reader: DatasetReader, dataset: Dataset) -> Dataset:
    """What a reader made, without rows that a logger wrote again, where a sensor's format says that loggers do."""
    require_made(dataset, Dataset, f"reader {reader.name!r}")
    logged_again = any(sensor_format(name).logged_again for name in dataset.log.sensors)
    return without_rows_logged_again(dataset) if logged_again else dataset


class DatasetFolderReader(DatasetReader):
    """Folders with a dataset.toml, asked first: whatever else lies there is part of the data set."""

    name, order, words = "folder", 0, "a folder"

    def recognises(self, path: Path) -> bool:
        """Whether a path is a folder with a dataset.toml."""
        return os.path.lexists(path / DATASET_FILE)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the folder."""
        return read_folder(path, front_end_of)


class PhyphoxReader(StatedReader):
    """Exports of phyphox, and the table in one."""

    name, order, words = "phyphox", 10, "a phyphox export"
    has_segments = True
    holds = (PHYPHOX_TABLE,)

    def recognises(self, path: Path) -> bool:
        """Whether a path is the folder, or the table in it."""
        return (path.name in self.holds and os.path.isfile(path)) or super().recognises(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """A kept segment, or the only one."""
        from spinfilters.io.phone_exports import read_phyphox_trial

        return read_phyphox_trial(path, segment, self.options)

    def whole(self, path: Path) -> Dataset:
        """The whole recording, whatever is marked in it."""
        from spinfilters.io.phone_exports import read_phyphox_whole

        return read_phyphox_whole(path, self.options)

    def segments(self, path: Path, on_refused: OnRefused | None) -> list[Dataset]:
        """Every kept segment."""
        from spinfilters.io.phone_exports import read_phyphox_trials

        return read_phyphox_trials(path, on_refused, self.options)


class PhoneExportReader(StatedReader):
    """Folders of Sensor Logger, of phyphox' experiments of several sensors and of alike apps."""

    name, order, words = "phone-export", 20, "a phone export"
    holds = ("Gyroscope.csv", "GyroscopeUncalibrated.csv")

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates of the phone, and its accelerometer where there is one."""
        from spinfilters.io.phone_exports import read_phone_export

        return read_phone_export(path, self.held(path) or path, self.options)


class LoggerFolderReader(StatedReader):
    """Root of a recording in the layout of EuRoC or TUM: its rates, or its poses where it has no rates."""

    name, order, words = "logger-folder", 25, "a folder of EuRoC or TUM"
    holds = tuple(
        root + table
        for table in (
            *("imu0/data.csv", "imu/data.csv", "imu.csv", "imu.txt", "groundtruth.txt"),
            *("state_groundtruth_estimate0/data.csv", "vicon0/data.csv", "mocap0/data.csv", "gt/data.csv"),
        )
        for root in ("", "mav0/")
    )

    def held(self, path: Path) -> Path | None:
        """The first of the files in a folder, or the table of a topic that ulog2csv wrote of one PX4 log."""
        if (found := super().held(path)) is not None or not os.path.isdir(path):
            return found
        from spinfilters.io.flight_logs import table_of_topic

        return table_of_topic(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table."""
        from spinfilters.io.motion_file import read_logger_folder

        return read_logger_folder(path, self.held(path) or path, self.options)


class KittiFolderReader(StatedReader):
    """Drives of raw KITTI."""

    name, order, words = "kitti-oxts", 26, "a drive of raw KITTI"
    holds = ("timestamps.txt", "oxts/timestamps.txt")

    def recognises(self, path: Path) -> bool:
        """Whether a folder, or oxts in it, holds times and data."""
        if not super().recognises(path):
            return False
        from spinfilters.io.number_folders import oxts_folder

        return oxts_folder(path) is not None

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates of all epochs."""
        from spinfilters.io.number_folders import read_kitti_folder

        return read_kitti_folder(path, self.options)


class Simulator42Reader(StatedReader):
    """Folders that the simulator 42 wrote."""

    name, order, words = "simulator-42", 27, "a folder of the simulator 42"
    holds = ("wbn.42", "qbn.42", "wbn00.42", "qbn00.42")

    def recognises(self, path: Path) -> bool:
        """Whether a folder holds the times, and rates or attitudes."""
        return os.path.isfile(path / "time.42") and super().recognises(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates, else attitudes."""
        from spinfilters.io.number_folders import read_simulator_42

        return read_simulator_42(path, self.options)


class ZipReader(StatedReader):
    """Archives of an export: the readers are asked for the folder that one packs."""

    name, order, words = "zip", 30, "a .zip of an export"
    has_segments = True
    suffixes = (".zip",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the archive."""
        from spinfilters.io.zip_export import Unpacked

        with Unpacked(path) as folder:
            reader = reader_of(folder, self.options)
            _require_segments(reader, path, segment)
            return replace(reader.read(folder, segment), path=path)

    def whole(self, path: Path) -> Dataset:
        """The whole recording of the archive."""
        from spinfilters.io.zip_export import Unpacked

        with Unpacked(path) as folder:
            return replace(reader_of(folder, self.options).whole(folder), path=path)

    def segments(self, path: Path, on_refused: OnRefused | None) -> list[Dataset]:
        """Every kept segment of the archive."""
        from spinfilters.io.zip_export import Unpacked

        with Unpacked(path) as folder:
            found = reader_of(folder, self.options).segments(folder, on_refused)
            return [replace(each, path=path) for each in found]


class SpreadsheetReader(StatedReader):
    """Workbooks of Excel, whose sheets are tables."""

    name, order, words = "spreadsheet", 31, "a workbook (.xlsx)"
    suffixes = (".xlsx",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the first sheet that describes a motion."""
        from spinfilters.io.spreadsheet import read_spreadsheet

        return read_spreadsheet(path, self.options)


class MatrixFolderReader(StatedReader):
    """Folders with a pose in each file."""

    name, order, words = "matrix-folder", 28, "a folder with a matrix in each file"

    def recognises(self, path: Path) -> bool:
        """Whether a folder holds numbered texts of one matrix each."""
        if not os.path.isdir(path):
            return False
        from spinfilters.io.number_folders import matrix_files

        return bool(matrix_files(path))

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Poses, at the stated rate or the times of a table beside them."""
        from spinfilters.io.number_folders import read_matrix_folder

        return read_matrix_folder(path, self.options)


class RosBagReader(StatedReader):
    """Bags of ROS 1 and 2, and MCAP files."""

    name, order, words = "ros-bag", 40, "a ROS bag (.bag, .mcap)"
    suffixes = (".bag", ".mcap", ".db3")
    holds = ("metadata.yaml",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates or poses of one topic, which the user states where a bag has several."""
        from spinfilters.io.ros_bag import read_ros_bag

        return read_ros_bag(path, self.options)


class EchoedMessagesReader(StatedReader):
    """Texts of rostopic echo."""

    name, order, words = "echoed-messages", 41, "a text of rostopic echo"

    def recognises(self, path: Path) -> bool:
        """Whether a text begins with a message."""
        if not is_file_named(path, (".txt", ".yaml", ".yml", ".log")):
            return False
        from spinfilters.io.text_logs import has_echoed_messages

        return has_echoed_messages(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Motion of all whole messages."""
        from spinfilters.io.text_logs import read_echoed_messages

        return read_echoed_messages(path, self.options)


class Px4LogReader(StatedReader):
    """PX4 flight logs."""

    name, order, words = "px4-log", 42, "a PX4 log (.ulg)"
    suffixes = (".ulg",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates or attitudes of the topic that the user states, or of the first that describes a motion."""
        from spinfilters.io.flight_logs import read_px4_log

        return read_px4_log(path, self.options)


class ArduPilotLogReader(StatedReader):
    """ArduPilot logs: the binary one begins with a message, its text with a format."""

    name, order, words = "ardupilot-log", 43, "an ArduPilot log (.bin, .log)"
    suffixes = (".bin", ".log")
    magic = (b"\xa3\x95", b"FMT,")

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates of the first gyro of the first message that has some."""
        from spinfilters.io.flight_logs import read_ardupilot_log

        return read_ardupilot_log(path, self.options)


class TypedRowsReader(StatedReader):
    """Tables with rows of several sensors."""

    name, order, words = "typed-rows", 44, "a table of GnssLogger or RealSense"

    def recognises(self, path: Path) -> bool:
        """Whether the first lines list the columns of a sensor of its own."""
        if not is_file_named(path, (".csv", ".txt", ".log")):
            return False
        from spinfilters.io.text_logs import has_typed_rows

        return has_typed_rows(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Measurements of the sensor that the user states, or of the first that describes a motion."""
        from spinfilters.io.text_logs import read_typed_rows

        return read_typed_rows(path, self.options)


class ArrayExportReader(StatedReader):
    """Files of named arrays; columns are known by their names as those of a text table."""

    name, order, words = "array-export", 45, "a .npz, .mat, .h5, .nc, .parquet, .feather or .json of arrays"
    suffixes = (
        *(".npz", ".mat", ".h5", ".hdf5", ".nc", ".parquet", ".pq", ".feather", ".arrow"),
        *(".json", ".jsonl", ".ndjson"),
    )

    def recognises(self, path: Path) -> bool:
        """Whether its suffix is one of these, or a YAML file begins with a list or has several documents."""
        if not is_file_named(path, (".yaml", ".yml")):
            return super().recognises(path)
        begin = first_text(path, _HEAD)
        return begin.startswith(("- ", "-\n")) or len(_DOCUMENT.findall(begin)) > 1

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the arrays that describe a motion."""
        from spinfilters.io.array_exports import read_array_export

        return read_array_export(path, self.options)


_DOCUMENT: Final = re.compile(r"^---\s*$", re.MULTILINE)
_LABELLED: Final = re.compile(
    r"""[A-Za-z_\]]["']?\s*[:=]?\s*[\[({]*\s*[-+.\d]|[\]})]\s*[:=]|[A-Za-z_],[-+.\d]"""
)
"""A label with a number, which lines of labels have at least."""


class LabelledLinesReader(StatedReader):
    """Logs of a serial port: lines of labels with numbers."""

    name, order, words = "labelled-lines", 46, "a log of a serial port"

    def recognises(self, path: Path) -> bool:
        """Whether most of the first lines are labels with numbers."""
        if not is_file_named(path, (".log", ".txt", ".csv", ".dat", ".out", ".data")):
            return False
        if _LABELLED.search(first_text(path, _HEAD)) is None:
            return False
        from spinfilters.io.labelled_lines import has_labelled_lines

        return has_labelled_lines(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates of the lines that have some."""
        from spinfilters.io.labelled_lines import read_labelled_lines

        return read_labelled_lines(path, self.options)


class AttitudeEphemerisReader(StatedReader):
    """Attitude ephemerides; those of positions (.e, .oem) are refused as what they are."""

    name, order, words = "attitude-ephemeris", 47, "an attitude ephemeris (.a, .aem, .acm)"
    suffixes = (".a", ".aem", ".acm", ".xml", ".e", ".oem")

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Attitudes of all rows."""
        from spinfilters.io.attitude_ephemeris import read_attitude_ephemeris

        return read_attitude_ephemeris(path, self.options)


class MvnxReader(StatedReader):
    """Exports of Xsens MVN."""

    name, order, words = "mvnx", 48, "an Xsens MVN export (.mvnx)"
    suffixes = (".mvnx",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Poses of the only segment, or of the one that the user names by the topic."""
        from spinfilters.io.mvnx_file import read_mvnx

        return read_mvnx(path, self.options)


class GyroflowReader(StatedReader):
    """Logs of Gyroflow."""

    name, order, words = "gyroflow", 49, "a log of Gyroflow (.gcsv)"
    suffixes = (".gcsv",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates about the axes of the log."""
        from spinfilters.io.text_logs import read_gyroflow

        return read_gyroflow(path, self.options)


class LineProtocolReader(StatedReader):
    """Exports of InfluxDB in its line protocol."""

    name, order, words = "line-protocol", 39, "line protocol of InfluxDB (.lp)"

    def recognises(self, path: Path) -> bool:
        """Whether the first lines of a text are lines of the protocol."""
        if not is_file_named(path, (".lp", ".txt", ".line", ".influx", ".log")):
            return False
        from spinfilters.io.line_protocol import has_line_protocol

        return has_line_protocol(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates, poses or attitudes of one measurement."""
        from spinfilters.io.line_protocol import read_line_protocol

        return read_line_protocol(path, self.options)


class ColmapReader(StatedReader):
    """Reconstructions of COLMAP as text."""

    name, order, words = "colmap", 56, "images.txt of COLMAP"

    def recognises(self, path: Path) -> bool:
        """Whether the comments of a text list the columns of COLMAP's images."""
        if not is_file_named(path, (".txt",)):
            return False
        from spinfilters.io.pose_graph import has_colmap_images

        return has_colmap_images(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Poses of the reconstructed body in the camera."""
        from spinfilters.io.pose_graph import read_colmap_images

        return read_colmap_images(path, self.options)


class PoseGraphReader(StatedReader):
    """Pose graphs of g2o."""

    name, order, words = "pose-graph", 51, "a pose graph (.g2o)"
    suffixes = (".g2o",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Poses of the vertices, at the stated rate."""
        from spinfilters.io.pose_graph import read_pose_graph

        return read_pose_graph(path, self.options)


class LabviewReader(StatedReader):
    """Measurement files of LabVIEW."""

    name, order, words = "labview", 52, "a LabVIEW file (.lvm)"
    suffixes = (".lvm",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates, poses or attitudes of its channels."""
        from spinfilters.io.labview_file import read_labview_file

        return read_labview_file(path, self.options)


class OpenSimReader(StatedReader):
    """Orientations of OpenSim."""

    name, order, words = "opensim", 53, "a table of OpenSim (.sto)"
    suffixes = (".sto",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Attitudes of the only body, or of the one that the user names by the topic."""
        from spinfilters.io.opensim_table import read_opensim_table

        return read_opensim_table(path, self.options)


class ArrayFileReader(ArrayExportReader):
    """Single arrays, asked for behind others' readers: what they hold has no names."""

    name, order, words = "array-file", 54, "an array .npy"
    suffixes = (".npy",)


class BvhReader(StatedReader):
    """Motion of a skeleton."""

    name, order, words = "bvh", 55, "a skeleton's motion (.bvh)"
    suffixes = (".bvh",)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Poses of the root."""
        from spinfilters.io.bvh_file import read_bvh

        return read_bvh(path, self.options)


_HEAD: Final = 1 << 12
_IN_BRACKETS: Final = re.compile(r"[(\[]\s*[-+.\d]")
_WORD_AND_NUMBER: Final = re.compile(r"[A-Za-z]{2}[ \t,;|]+[-+.\d]")
"""What the first lines of a table of vectors, and of rows told by a word, have at least."""


class VectorCellsReader(StatedReader):
    """Tables with vectors in brackets."""

    name, order, words = "vector-cells", 92, "a table of vectors in brackets"

    def recognises(self, path: Path) -> bool:
        """Whether the first rows of a text hold vectors in brackets."""
        if not is_file_named(path, (".csv", ".tsv", ".txt", ".dat", ".log", ".out")):
            return False
        if _IN_BRACKETS.search(first_text(path, _HEAD)) is None:
            return False
        from spinfilters.io.vector_cells import has_vector_cells

        return has_vector_cells(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table."""
        from spinfilters.io.vector_cells import read_vector_cells

        return read_vector_cells(path, self.options)


class WordedRowsReader(StatedReader):
    """Logs of several sensors without a header."""

    name, order, words = "worded-rows", 93, "a log of rows told by a word"

    def recognises(self, path: Path) -> bool:
        """Whether the first rows of a text are told by words, some of them by that of a gyro."""
        if not is_file_named(path, (".csv", ".txt", ".dat", ".log", ".data", ".nmea")):
            return False
        if _WORD_AND_NUMBER.search(first_text(path, _HEAD)) is None:
            return False
        from spinfilters.io.worded_rows import has_worded_rows

        return has_worded_rows(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Rates of the gyro."""
        from spinfilters.io.worded_rows import read_worded_rows

        return read_worded_rows(path, self.options)


class OtherFolderReader(DatasetReader):
    """Any folder that no other reader recognises: refused with what it lacks."""

    name, order, words = "other-folder", 90, DatasetFolderReader.words

    def recognises(self, path: Path) -> bool:
        """Whether a path is a folder."""
        return os.path.isdir(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """InputError: always."""
        require_folder(path)
        raise undescribed_folder(path, recordings_in(path))


class MotionFileReader(StatedReader):
    """Tables of a motion, whose columns are known by their names."""

    name, order, words = "motion-table", 95, "a gyro .csv"

    def recognises(self, path: Path) -> bool:
        """Whether a file is a single table, by suffix and name or its first rows, and not a part of a data set folder."""
        from spinfilters.io.motion_file import has_rows_of_numbers, is_motion_file

        if is_file_named(path, (".csv", ".tsv", ".tab", ".txt", ".dat", ".asc", ".log", ".data")):
            return is_motion_file(path)
        return has_rows_of_numbers(path)

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the table."""
        from spinfilters.io.motion_file import read_motion_file

        return read_motion_file(path, self.options)


class SensorTableReader(DatasetReader):
    """Any path that no other reader recognises: the table of one sensor, or refused."""

    name, order, words = "sensor-table", 100, ""

    def recognises(self, path: Path) -> bool:
        """Always: this reader is asked last."""
        return True

    def read(self, path: Path, segment: int | None) -> Dataset:
        """Data set of the one table."""
        return read_sensor_table(path, lambda: (reader.words for reader in dataset_readers()))


OWN_READERS: Final[tuple[DatasetReader, ...]] = (
    DatasetFolderReader(),
    PhyphoxReader(),
    PhoneExportReader(),
    LoggerFolderReader(),
    KittiFolderReader(),
    Simulator42Reader(),
    MatrixFolderReader(),
    ZipReader(),
    SpreadsheetReader(),
    LineProtocolReader(),
    RosBagReader(),
    EchoedMessagesReader(),
    Px4LogReader(),
    ArduPilotLogReader(),
    TypedRowsReader(),
    ArrayExportReader(),
    LabelledLinesReader(),
    AttitudeEphemerisReader(),
    MvnxReader(),
    GyroflowReader(),
    PoseGraphReader(),
    LabviewReader(),
    OpenSimReader(),
    ArrayFileReader(),
    BvhReader(),
    ColmapReader(),
    OtherFolderReader(),
    VectorCellsReader(),
    WordedRowsReader(),
    MotionFileReader(),
    SensorTableReader(),
)
"""Ours, as they are asked."""
