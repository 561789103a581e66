"""Items of the sources: each ends with a number and a word, is written as a whole, and is not made twice."""

import json
from pathlib import Path

import pytest

from spinfilters.core.errors import InputError
from spinfilters.reproduction import results
from spinfilters.reproduction.item import TWEDDLE, Agreement, ComparedNumber, Item, ItemResult
from spinfilters.reproduction.items import ITEMS, chosen_items
from spinfilters.reproduction.results import code_hash, record_of, reproduce, write_pages

LONGEST = 3.0
"""s, of an item that is made in full."""
RECORD = json.loads((Path(__file__).parents[2] / "docs" / "reference" / "reproduction.json").read_text())
"""All items as a wheel made them in an empty directory: ``spinfilters reproduce all --record FILE``."""


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.name)
def test_every_item_has_rows_and_a_picture(item: Item) -> None:
    assert item.short is not None or item.seconds <= LONGEST
    outcome = (item.short or item.make)()
    assert outcome.rows
    assert outcome.figures
    if item.short is None:  # made in full, as for the record
        recorded = RECORD["items"][item.name]["rows"]
        assert len(outcome.rows) == sum(recorded.values())
        # rows that differ say why by a number; one that newly differs is a change of what the package finds
        differing = [row.what for row in outcome.rows if row.agreement is Agreement.DIFFERS]
        assert len(differing) <= recorded.get(Agreement.DIFFERS.value, 0), differing


def test_the_record_has_every_item_and_none_that_failed() -> None:
    assert list(RECORD["items"]) == [item.name for item in ITEMS]
    words = {word.value for word in Agreement}
    assert {each["result"] for each in RECORD["items"].values()} <= words
    assert sum(RECORD["counts"]["items"].values()) == len(ITEMS)
    rows = [count for each in RECORD["items"].values() for count in each["rows"].values()]
    assert sum(RECORD["counts"]["rows"].values()) == sum(rows)


def test_names_are_unique_and_say_source_and_kind() -> None:
    names = [item.name for item in ITEMS]
    assert len(set(names)) == len(names)
    assert all(name.split("-")[0] in ("tweddle", "decoust") for name in names)


def test_rows_agree_within_the_printed_digits_only() -> None:
    assert ComparedNumber("rate", 2.204, printed=2.20, tolerance=0.005).agreement is Agreement.AGREES
    assert ComparedNumber("error", 1.0, printed=2.0, smaller_is_better=True).agreement is Agreement.BETTER
    assert (
        ComparedNumber("error", 3.0, printed=2.0, smaller_is_better=True, why="2 other ones").agreement
        is Agreement.DIFFERS
    )
    with pytest.raises(InputError, match="nothing says why"):
        ComparedNumber("rate", 2.21, printed=2.20, tolerance=0.005)
    with pytest.raises(InputError, match="nothing says why"):
        ComparedNumber("rate", float("nan"), printed=2.20, tolerance=0.005)
    with pytest.raises(InputError, match="nothing says why"):
        ComparedNumber("surfaces", 3.0, expected=(4.0, float("inf")))
    with pytest.raises(InputError, match="what is printed"):
        ComparedNumber("rate", 2.21)


def test_a_printed_number_of_either_sign_is_bettered_by_a_smaller_one() -> None:
    error = ComparedNumber("mean", 0.5, printed=-6.27, tolerance=0.3, smaller_is_better=True)
    assert error.agreement is Agreement.BETTER
    larger = ComparedNumber("mean", 7.0, printed=-6.27, smaller_is_better=True, why="7 cm were drawn")
    assert larger.agreement is Agreement.DIFFERS


def test_pictures_and_inputs_do_not_count_as_agreement() -> None:
    shown = ComparedNumber("share", 0.7, expected=(0.5, 1.0))
    put_in = ComparedNumber("distance", 500.0, printed=500.0, given=True)
    printed = ComparedNumber("radius", 866.02, printed=866.02)
    assert shown.agreement is Agreement.CONSISTENT
    assert put_in.agreement is Agreement.INPUT
    assert ItemResult([put_in]).agreement is Agreement.INPUT
    assert ItemResult([put_in, shown]).agreement is Agreement.CONSISTENT
    assert ItemResult([put_in, shown, printed]).agreement is Agreement.AGREES


@pytest.mark.parametrize(
    "why",
    [
        "another machine",
        "see Table 4.1, and Figures 6-3 to 6-14",
        "the screen of Figure 5-29 and Eq. 6.22 of section 6.5.2 differ in k1",
    ],
)
def test_a_cause_without_a_number_is_refused(why: str) -> None:
    with pytest.raises(InputError, match="give a number"):
        ComparedNumber("rate", 2.21, printed=2.20, why=why)
    with pytest.raises(InputError, match="give a number"):
        ComparedNumber("rate", 2.20, printed=2.20, why=why)


@pytest.mark.parametrize("why", ["0.02 deg at 3 m", "82% of Table 4.1", "J = (3, 1)", "k1 is -0.0227"])
def test_a_cause_with_a_number_is_taken(why: str) -> None:
    assert ComparedNumber("rate", 2.21, printed=2.20, why=why).agreement is Agreement.DIFFERS


def test_a_row_without_a_bound_says_why(tmp_path: Path) -> None:
    rows = [
        ComparedNumber("error", 1.0, printed=1.0, bound=0.25),
        ComparedNumber("time", 1.0, printed=1.0, bound="no estimate: a time"),
    ]
    reproduce([item(lambda: ItemResult(rows))], tmp_path)
    bounded, timed = (tmp_path / "reproduce.csv").read_text().splitlines()[1:]
    assert bounded.split(",")[6] == "0.25"
    assert timed.split(",")[6] == "no estimate: a time"


def item(make: object, name: str = "tweddle-table-1.1") -> Item:
    return Item(name, TWEDDLE, "Table", "a test", make)  # pyright: ignore[reportArgumentType]


def test_what_is_there_is_kept_and_made_again_on_demand(tmp_path: Path) -> None:
    made = []

    def make() -> ItemResult:
        made.append(1)
        return ItemResult(
            [ComparedNumber("rate", 1.0, printed=1.0)], tables={"course": [{"time": 0.5, "rate": 2}]}
        )

    one = item(make)
    assert not reproduce([one], tmp_path)[0].kept
    assert reproduce([one], tmp_path)[0].kept
    assert not reproduce([one], tmp_path, again=True)[0].kept
    assert len(made) == 2
    assert (tmp_path / one.name / "course.csv").read_text() == "time,rate\n0.5,2\n"
    assert "1 agrees, of 1 items" in (tmp_path / "reproduce.html").read_text()


def test_an_item_that_cannot_be_made_says_why_and_is_tried_again(tmp_path: Path) -> None:
    def fail() -> ItemResult:
        raise InputError("the scan is empty; give points")

    failed = reproduce([item(fail)], tmp_path)[0]
    assert failed.agreement == "failed"
    assert "the scan is empty" in (tmp_path / "reproduce.html").read_text()
    assert not reproduce([item(fail)], tmp_path)[0].kept


def test_damaged_results_are_made_again_or_refused(tmp_path: Path) -> None:
    one = item(lambda: ItemResult([ComparedNumber("rate", 1.0, printed=1.0)]))
    place = tmp_path / one.name
    reproduce([one], tmp_path)
    (place / "own.txt").write_text("mine")
    assert reproduce([one], tmp_path)[0].kept
    with pytest.raises(InputError, match=r"own\.txt"):
        reproduce([one], tmp_path, again=True)
    (place / "own.txt").unlink()
    document = json.loads((place / "item.json").read_text())
    (place / "item.json").write_text(json.dumps(document | {"rows": 3}))
    with pytest.raises(InputError, match="changed since"):
        reproduce([one], tmp_path)


@pytest.mark.parametrize("changed", [{"rows": [3]}, {"pictures": [None]}, {"result": 1}, {"name": "other"}])
def test_items_that_somebody_changed_are_left_out_of_the_page(
    changed: dict[str, object], tmp_path: Path
) -> None:
    one = item(lambda: ItemResult([ComparedNumber("rate", 1.0, printed=1.0)]))
    reproduce([one], tmp_path)
    path = tmp_path / one.name / "item.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    (tmp_path / "reproduce.html").unlink()
    write_pages(tmp_path)
    assert not (tmp_path / "reproduce.html").exists()


def test_names_choose_items_by_their_beginning() -> None:
    assert chosen_items(()) == ITEMS
    assert [each.name for each in chosen_items(("tweddle-table-1.1",))] == ["tweddle-table-1.1"]
    assert len(chosen_items(("tweddle-figure-2",))) >= 5
    with pytest.raises(InputError, match="reproduce list"):
        chosen_items(("tweddle-figure-99",))


def test_the_summary_counts_items_and_rows_and_names_the_code(tmp_path: Path) -> None:
    one = item(lambda: ItemResult([ComparedNumber("rate", 1.0, printed=1.0)]))
    record = record_of(reproduce([one], tmp_path), "2026-11-26T00:00:00+00:00")
    assert record["items"][one.name]["result"] == "agrees"
    assert record["counts"] == {"items": {"agrees": 1}, "rows": {"agrees": 1}}
    assert record["code"] == code_hash()


def test_items_of_other_code_are_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = item(lambda: ItemResult([ComparedNumber("rate", 1.0, printed=1.0)]))
    reproduce([one], tmp_path)
    monkeypatch.setattr(results, "code_hash", lambda: "other")
    assert not reproduce([one], tmp_path)[0].kept
    assert reproduce([one], tmp_path)[0].kept
