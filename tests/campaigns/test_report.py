"""The report: intervals, the confusion table, a page that holds everything and trusts nothing."""

import copy
import re
from pathlib import Path

import numpy as np
import pytest

from spinfilters.campaigns.campaign_report import write_report
from spinfilters.campaigns.rows_folder import RowsFolder, keep_study, open_folder, read_rows
from spinfilters.campaigns.runner import asked, ended
from spinfilters.campaigns.statistics import cell_summaries, mean, ratio_of_squares, root_mean_square, share
from spinfilters.campaigns.study import Study, study_from
from tests.campaigns.study_samples import GYRO

EVIL = "<script>alert(1)</script> & $x$"


def _study() -> Study:
    document = copy.deepcopy(GYRO)
    document["study"] |= {"name": EVIL, "seeds": 40, "description": EVIL}
    document["factors"]["motion"] = [EVIL, "short"]
    document["motion"] = {EVIL: {}, "short": {"epochs": 30}}
    return study_from(document, "study")


def _row(study: Study, run: int, generator: np.random.Generator) -> dict:
    if run % 37 == 5:
        return ended(study, run, "killed", EVIL, 1.0)
    nees = generator.chisquare(60, 30) / 60
    drawn = {name: float(generator.standard_normal()) for name in ("error_rate_rad_s", "error_k1")}
    verdict = {"verdict": "ok", "right": run % 20 != 0, "worst_error": 1.0, "worst_quantity": "w"}
    over_time = {"nees_time_s": np.arange(30.0).tolist(), "nees_over_time": nees.tolist()}
    found = {"outcome": "done", "nees": float(nees.mean()), "nees_last": float(nees[-1]), "dof": 60}
    told = {"finished": "2026-01-01T00:00:00.000", "host": EVIL, "version": "1", "packages": "p"}
    return (
        asked(study, run)
        | drawn
        | verdict
        | over_time
        | found
        | told
        | {"bound_rate_rad_s": 1.0, "reason": ""}
        | (
            {"holds_rate": "not determined"}
            if study.cells[study.run(run).cell].levels["motion"] == "short"
            else {}
        )
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place, study = tmp_path_factory.mktemp("campaign"), _study()
    generator = np.random.default_rng(0)
    open_folder(place, study, resume=False)
    keep_study(place, study, ())
    with RowsFolder(place, study.columns) as rows:
        for run in range(len(study)):
            rows.append(_row(study, run, generator))
    write_report(place)
    return place


def test_the_page_needs_nothing_else_and_escapes_what_it_was_given(folder: Path) -> None:
    page = (folder / "report" / "index.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)
    assert "Content-Security-Policy" in page
    assert len(page) < 10_000_000


def test_what_a_cell_does_not_determine_is_hatched(folder: Path) -> None:
    study = _study()
    rows = read_rows(folder, study.columns)
    for cell in cell_summaries(study, rows):
        assert (cell.undetermined["rate"] > 0.5) == (cell.levels["motion"] == "short")
        assert cell.undetermined["moments"] == 0.0
    page = (folder / "report" / "index.html").read_text()
    hatched = page.count('title="not determined"')
    assert hatched == sum(cell.undetermined["rate"] > 0.5 for cell in cell_summaries(study, rows))
    assert "not determined in most runs" in (folder / "report" / "bound.svg").read_text()


def test_pictures_are_there_as_png_and_svg(folder: Path) -> None:
    for name in ("nees", "bound", "verdicts"):
        assert (folder / "report" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (folder / "report" / f"{name}.svg").read_text()


def test_every_run_that_went_wrong_has_the_command_that_repeats_it(folder: Path) -> None:
    page = (folder / "report" / "index.html").read_text()
    wrong = [run for run in range(160) if run % 37 == 5 or run % 20 == 0]
    for run in wrong:
        assert f"spinfilters campaign repeat {folder} {run} -o" in page
    assert page.count("<details id=") == len(wrong)


def test_summaries_count_what_the_rows_say(folder: Path) -> None:
    study = _study()
    cells = list(cell_summaries(study, read_rows(folder, study.columns)))
    assert [cell.runs for cell in cells] == [40] * 4
    assert sum(cell.verdicts.get(("ok", "wrong"), 0) for cell in cells) == 8
    assert sum(cell.outcomes.get("killed", 0) for cell in cells) == 5
    for cell in cells:
        assert cell.nees.low < 1 < cell.nees.high or abs(cell.nees.value - 1) < 0.05
        assert cell.over_time.inside > 0.8
        assert cell.band[0] < 1 < cell.band[1]


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    generator, hits = np.random.default_rng(1), np.zeros(4)
    for _ in range(400):
        values, bounds = 2.0 * generator.standard_normal(60), generator.uniform(0.5, 1.5, 60)
        found = (
            (mean(values), 0.0),
            (root_mean_square(values), 2.0),
            (ratio_of_squares(3.0 * bounds * generator.standard_normal(60), bounds), 3.0),
            (share(int((generator.random(60) < 0.9).sum()), 60), 0.9),
        )
        hits += [each.low <= true <= each.high for each, true in found]
    assert (hits / 400 > 0.88).all()
    assert (hits / 400 < 0.99).all()


def test_a_report_of_nothing_is_refused(tmp_path: Path) -> None:
    from spinfilters.core.errors import InputError

    with pytest.raises(InputError, match="no campaign's folder"):
        write_report(tmp_path)
    open_folder(tmp_path, _study(), resume=False)
    keep_study(tmp_path, _study(), ())
    with pytest.raises(InputError, match="no rows yet"):
        write_report(tmp_path)
