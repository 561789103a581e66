"""Ready studies of filters beside smoothers: their files, their numbers, and the estimator that they name."""

import copy
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from spinfilters.campaigns.filter_comparison import (
    NAMES,
    LevelResult,
    by_level,
    level_results,
    ready_study,
    recommended,
    study_file,
    write_comparison_page,
)
from spinfilters.campaigns.rows_folder import RowsFolder, keep_study, open_folder, read_rows
from spinfilters.campaigns.runner import Runner, asked, ended
from spinfilters.campaigns.statistics import MARKERS, positive_mean
from spinfilters.campaigns.study import Study, study_from
from spinfilters.core.errors import InputError
from spinfilters.plots.printing import PrintStyle
from spinfilters.plots.style import estimator_lines
from tests.campaigns.study_samples import gyro_document

SHARES = {"smoother": 1.0, "mekf": 1.02, "ukf": 1.5}
"""Errors over the smoother's of drawn rows."""


def _study() -> Study:
    document = copy.deepcopy(gyro_document(seeds=30))
    document["factors"]["estimator"] = list(SHARES)
    return study_from(document, "study")


def _row(study: Study, run: int) -> dict:
    """A row whose recording has a difficulty that all its estimators share."""
    row, generator = asked(study, run), np.random.default_rng(run)
    if run == 7:
        return ended(study, run, "killed", "memory", 1.0)
    difficulty = np.exp(np.random.default_rng(run // 6).standard_normal())
    name = row["estimator"]
    error = SHARES[name] * difficulty * np.exp(0.02 * generator.standard_normal())
    nees = generator.chisquare(60, 30) / 60
    nees[:3] = 9.0
    return row | {
        "outcome": "done",
        "verdict": "degraded",
        "right": name != "ukf" or run % 2 == 0,
        "error_attitude_rad": error,
        "error_rate_rad_s": error,
        "error_k1": error,
        "error_k2": error,
        "nees": float(nees.mean()),
        "nees_last": float(nees[-1]),
        "dof": 60,
        "nees_time_s": np.arange(30.0).tolist(),
        "nees_over_time": nees.tolist(),
        "time_per_epoch_s": 0.01 if name == "smoother" else 0.001,
        "time_estimate_s": (0.3 if name == "smoother" else 0.03) * (1 + run % 5 / 50),
        "finished": "2026-01-01T00:00:00.000",
        "host": "here",
        "version": "1",
        "packages": "p",
    }


def _written(folder: Path, study: Study) -> None:
    folder.mkdir(parents=True)
    open_folder(folder, study, resume=False)
    keep_study(folder, study, ())
    with RowsFolder(folder, study.columns) as rows:
        for run in range(len(study)):
            rows.append(_row(study, run))


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[LevelResult]:
    place, study = tmp_path_factory.mktemp("studies") / "noise", _study()
    _written(place, study)
    return level_results(study, read_rows(place, study.columns, levels=study.levels))


def test_every_ready_study_is_listed_readable_and_has_the_smoother_or_a_filter_to_compare_with() -> None:
    there = {Path(str(each)).stem for each in (files("spinfilters.campaigns") / "studies").iterdir()}
    assert there == set(NAMES)
    for name in NAMES:
        study = ready_study(name)
        assert study.estimators > 1
        assert len(study) <= 1500
    with pytest.raises(InputError, match="cases, motions"):
        study_file("motion")


def test_ratios_leave_out_the_difficulty_of_the_recordings(results: list[LevelResult]) -> None:
    assert list(by_level(results)) == ["rich", "short"]
    for each in results:
        for title, ratio in each.ratios.items():
            assert ratio.low <= SHARES[each.estimator] * 1.01, title
            assert ratio.high >= SHARES[each.estimator] * 0.99, title
            assert ratio.high / ratio.low < 1.1
        assert each.lost == (
            1 if (each.level, each.estimator) == ("short", "smoother") and each.lost else each.lost
        )
    assert sum(each.lost for each in results) == 1


def test_convergence_is_the_time_after_the_last_epoch_above_the_limit(results: list[LevelResult]) -> None:
    assert all(each.converged.value > 0.9 for each in results)
    assert all(3.0 <= each.settling.value < 5.0 for each in results)


def test_the_cheapest_that_is_as_good_as_the_smoother_is_named(results: list[LevelResult]) -> None:
    for group in by_level(results).values():
        chosen = recommended(group)
        assert chosen is not None
        assert chosen.estimator == "mekf"
    assert recommended([each for each in results if each.estimator == "ukf"]) is None


def test_the_page_holds_what_is_there_and_says_where_nothing_is(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="spinfilters study all"):
        write_comparison_page(tmp_path)
    _written(tmp_path / "noise", _study())
    style = PrintStyle("svg", 84.0, True)
    page = write_comparison_page(tmp_path, print_style=style).read_text()
    assert "What to fly when" in page
    assert page.count("mekf") >= 4
    assert (tmp_path / "noise" / "comparison.png").stat().st_size > 10_000
    assert (tmp_path / "noise" / "pareto.png").stat().st_size > 10_000
    assert "error against processor time" in page
    assert len(list((tmp_path / "noise").glob("comparison*.svg"))) >= 6
    assert (tmp_path / "noise" / "pareto-1.svg").is_file()


def test_common_epochs_are_those_behind_the_filters_initialisation() -> None:
    document = gyro_document(seeds=1, epochs="common", bound="run")
    document["factors"] = {"estimator": ["mekf", "smoother"]}
    document["motion"] = {"base": document["motion"]["base"]}
    common = [Runner(study_from(document, "study")).row(run) for run in (0, 1)]
    document["study"]["epochs"] = "own"
    own = [Runner(study_from(document, "study")).row(run) for run in (0, 1)]
    assert common[0]["error_rate_rad_s"] == own[0]["error_rate_rad_s"]
    assert common[1]["error_rate_rad_s"] != own[1]["error_rate_rad_s"]
    assert common[1]["bound_rate_rad_s"] == common[0]["bound_rate_rad_s"]
    assert len(common[0]["nees_time_s"]) == len(common[1]["nees_time_s"]) < len(own[1]["nees_time_s"])


def test_the_option_leaves_the_fingerprint_of_earlier_studies() -> None:
    assert _study().fingerprint == study_from(copy.deepcopy(dict(_study().document)), "study").fingerprint
    document = copy.deepcopy(dict(_study().document))
    document["study"]["epochs"] = "common"
    assert study_from(document, "study").fingerprint != _study().fingerprint


def test_the_interval_of_a_positive_mean_stays_positive_where_one_run_is_far_off() -> None:
    found = positive_mean(np.array([1.0, 1.1, 0.9, 1.0, 2000.0]))
    assert found.value == pytest.approx(400.8)
    assert 0 < found.low < found.value < found.high


def test_the_interval_of_a_positive_mean_holds_the_mean_of_few_runs() -> None:
    generator = np.random.default_rng(3)
    found = [positive_mean(generator.chisquare(20, 5) / 20) for _ in range(400)]
    share = np.mean([each.low <= 1.0 <= each.high for each in found])
    assert share == pytest.approx(0.95, abs=0.03)


def test_no_two_estimators_of_a_ready_study_look_alike() -> None:
    for name in NAMES:
        estimators = list(dict.fromkeys(cell.estimator for cell in ready_study(name).cells))
        colours = [line.color for line in estimator_lines(estimators)]
        looks = {(colour, MARKERS[k % len(MARKERS)]) for k, colour in enumerate(colours)}
        assert len(looks) == len(estimators)
