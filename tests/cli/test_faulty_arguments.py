"""Arguments and configurations that a command cannot follow: exit code 2, one line that names the value, nothing written."""

from pathlib import Path

import pytest

from tests.cli.faults import refusal

CONFIG_FAULTS = {
    "not TOML": ("estimators = ", "config.toml: is not TOML"),
    "unknown table": ("[filter]\na = 1", "'filter'"),
    "unknown key": ("[process]\nforce = 1", "process.force"),
    "text for a number": ('[process]\nforce_psd = "big"', "process.force_psd is 'big'"),
    "truth value for a number": ("[ukf]\nalpha = true", "ukf.alpha is True"),
    "number for a truth value": ("[process]\ndrag = 1", "process.drag is 1"),
    "NaN": ("[ukf]\nbeta = nan", "ukf.beta is nan"),
    "beyond float64": ("[process]\ntolerance = 1" + 400 * "0", "process.tolerance"),
    "negative density": (
        "[process]\nforce_psd = -1.0",
        'process.force_psd is -1.0; give "auto" or 0 or a number from 1e-30',
    ),
    "negative std": ("[sensors]\npixel_std = -1.0", "sensors.pixel_std is -1.0"),
    "epochs beyond all": ("[initialisation]\nframes = 1" + 30 * "0", "initialisation.epochs is 1000"),
    "tolerance below rounding": (
        "[process]\ntolerance = 1e-300",
        "process.tolerance is 1e-300; give a number from 1e-12",
    ),
    "std below all": ("[sensors]\npixel_std = 1e-300", "sensors.pixel_std is 1e-300"),
    "a key of 5000 letters": ("[process]\n" + 5000 * "k" + " = 1", "unknown key process.kkk"),
    "an estimator of 5000 letters": ('estimators = ["' + 5000 * "k" + '"]', "unknown estimator 'kkk"),
    "tolerance of nothing": ("[process]\ntolerance = 0.0", "process.tolerance is 0.0"),
    "no epochs": ("[initialisation]\nframes = 0", "initialisation.epochs is 0"),
    "half an epoch": ("[initialisation]\nframes = 7.5", "initialisation.epochs is 7.5"),
    "table that is none": ("process = 3", "process is 3"),
    "estimators that are none": ("estimators = 3", "estimators is 3"),
    "unknown estimator": ('estimators = ["kalman"]', "config.toml: unknown estimator 'kalman'"),
    "no estimator": ("estimators = []", "none given"),
    "nested without end": ("a = " + 5000 * "[", "config.toml"),
}


@pytest.mark.parametrize(("content", "says"), CONFIG_FAULTS.values(), ids=CONFIG_FAULTS.keys())
def test_a_faulty_configuration_is_refused_in_one_line(
    content: str, says: str, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(content, encoding="utf-8")
    said = refusal(
        capsys, "compare", str(originals / "gyro"), "--config", str(config), "-o", str(tmp_path / "run")
    )
    assert says in said


ARGUMENT_FAULTS = {
    "no command": ("", "COMMAND"),
    "unknown command": ("guess", "'guess'"),
    "unknown option": ("compare --fast", "--fast"),
    "missing folder": ("compare {tmp}/nowhere -o {tmp}/run", "nowhere"),
    "empty folder": ("compare {tmp}/empty -o {tmp}/run", "empty/dataset.toml"),
    "not a data file": ("compare {tmp}/notes.md -o {tmp}/run", "'.md'"),
    "missing configuration": ("compare {gyro} --config {tmp}/none.toml", "none.toml"),
    "unknown estimator": ("compare {gyro} --estimators mekf,magic", "'magic'"),
    "estimator twice": ("compare {gyro} --estimators ukf,ukf", "ukf"),
    "no estimator": ("compare {gyro} --estimators ,", "none given"),
    "one estimator wanted": ("estimate {gyro} --estimator best", "'best'"),
    "segment not a number": ("compare {gyro} --segment first", "--segment 'first'"),
    "segment of digits that are none": ("compare {gyro} --segment ²", "--segment '²'"),
    "all segments of the simulation": ("compare --segment all", "--segment 'all' needs"),
    "segment of 400 digits": ("compare {gyro} --segment " + 400 * "9", "is no segment"),
    "seed beyond all": ("compare --seed 1" + 400 * "0", "--seed"),
    "a billion epochs": ("simulate -o {tmp}/s --frames 1000000000", "from 1 to 100000"),
    "epochs beyond all": ("simulate -o {tmp}/s --frames 1" + 400 * "0", "--frames"),
    "moments beyond all": ("simulate -o {tmp}/s --moments 1e300 1e300 1e300", "--moments"),
    "a prediction of years": ("compare {gyro} --predict 1e10", "from 1e-09 to 1e+09 s"),
    "segment beyond all": ("compare {gyro} --segment 99999999999999999999", "--segment '9999"),
    "segment of what has no flight": ("compare {gyro} --segment 1", "no free flight found in"),
    "segment of the simulation": ("compare --segment 1", "--segment '1'"),
    "negative seed": ("compare --seed -1", "--seed: '-1'"),
    "seed of a simulation negative": ("simulate -o {tmp}/s --seed -1", "--seed: '-1'"),
    "seed not a number": ("compare --seed x", "'x'"),
    "simulation nowhere": ("simulate", "--output"),
    "unknown kind of simulation": ("simulate -o {tmp}/s --kind radar", "'radar'"),
    "a single epoch": ("simulate -o {tmp}/s --frames 1", "1 epochs"),
    "epochs not a number": ("simulate -o {tmp}/s --frames many", "'many'"),
    "no interval": ("simulate -o {tmp}/s --interval 0", "--interval: '0'"),
    "interval NaN": ("simulate -o {tmp}/s --interval nan", "nan"),
    "interval infinite": ("simulate -o {tmp}/s --interval inf", "inf"),
    "rate NaN": ("simulate -o {tmp}/s --rate-rpm 1 nan 1", "nan"),
    "rate beyond all": ("simulate -o {tmp}/s --rate-rpm 1 1e30 1", "1e30"),
    "two moments": ("simulate -o {tmp}/s --moments 1 1", "--moments"),
    "moments of no body": ("simulate -o {tmp}/s --moments 1 1 3", "triangle"),
    "negative moment": ("simulate -o {tmp}/s --moments -1 1 1", "--moments: '-1'"),
    "moment NaN": ("simulate -o {tmp}/s --moments nan 1 1", "nan"),
    "simulation among other files": ("simulate -o {tmp}/foreign --frames 5", "foreign"),
    "simulation onto a file": ("simulate -o {tmp}/notes.md --kind gyro --frames 5", "notes.md"),
    "run onto a file": ("compare {gyro} -o {tmp}/notes.md", "notes.md"),
    "run by the name of a file": ("compare {gyro} -o {tmp}/errors.csv", "name of a .csv file"),
    "simulation by the name of a file": (
        "simulate -o {tmp}/gyro.CSV --kind gyro --frames 5",
        "name of a .CSV file",
    ),
    "run below a file": ("compare {gyro} -o {tmp}/notes.md/run", "notes.md/run"),
    "run among other files": ("compare {gyro} -o {tmp}/foreign", "foreign"),
    "plot of nothing": ("plot {tmp}/nowhere", "nowhere/summary.json"),
    "plot of no run": ("plot {tmp}/foreign", "foreign/summary.json"),
    "plot of a file": ("plot {tmp}/notes.md", "notes.md"),
}


@pytest.mark.parametrize(("command", "says"), ARGUMENT_FAULTS.values(), ids=ARGUMENT_FAULTS.keys())
def test_faulty_arguments_are_refused_in_one_line(
    command: str, says: str, originals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.md").write_text("notes", encoding="utf-8")
    (tmp_path / "foreign" / "dataset").mkdir(parents=True)
    (tmp_path / "foreign" / "config.toml").write_text("theirs = 1\n", encoding="utf-8")
    said = refusal(capsys, *(word.format(tmp=tmp_path, gyro=originals / "gyro") for word in command.split()))
    assert says in said
    assert not (tmp_path / "s").exists()
    assert {path.name for path in (tmp_path / "foreign").iterdir()} == {"config.toml", "dataset"}
    assert (tmp_path / "notes.md").read_text(encoding="utf-8") == "notes"
