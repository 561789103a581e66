"""Courses of live runs, and their pictures."""

import numpy as np

from spinfilters.live.answer import MOST_KEPT, Answer, CourseRecorder, LiveSummary
from spinfilters.live.terminal_view import answer_table
from spinfilters.models.status import EstimatorStatus
from spinfilters.plots.live_course import live_figure
from tests.live.test_executive import LAYOUT, started


def recorded(count: int, slow: int = -1) -> CourseRecorder:
    """Answers of a recorder; the one of this number takes a second, and half of them are degraded."""
    recorder, belief, doubted = CourseRecorder(0.02), started().belief, EstimatorStatus().degraded("a reason")
    for k in range(count):
        status, source = (doubted, "filter") if k < count // 2 else (EstimatorStatus(), "smoother")
        latency = 1.0 if k == slow else 0.001
        recorder.keep(Answer(0.1 * k, belief, status, source, 1, 0, latency))
    return recorder


def test_a_long_run_keeps_a_share_of_its_answers_and_the_slowest() -> None:
    course = recorded(5 * MOST_KEPT, slow=7001).course()
    assert MOST_KEPT // 4 < len(course.time) < MOST_KEPT
    assert course.stride == 8
    assert course.latency.max() == 1.0
    assert (np.diff(course.time) > 0).all()


def test_a_short_run_keeps_every_answer_with_its_source_and_verdict() -> None:
    course = recorded(10).course()
    assert course.stride == 1
    assert len(course.time) == 10
    assert course.smoothed.tolist() == course.ok.tolist() == 5 * [False] + 5 * [True]


def test_the_picture_says_how_many_answers_were_late_and_draws_runs_of_none_and_one() -> None:
    titles = [live_figure(recorded(count, slow=0).course()).get_suptitle() for count in (1, 10)]
    assert titles == ["Live: 1 answer, 1 after 20 ms", "Live: 10 answers, 1 after 20 ms"]
    assert [text.get_text() for text in live_figure(recorded(0).course()).texts] == ["no epoch was answered"]


def test_the_table_in_the_terminal_has_two_digits_of_every_deviation() -> None:
    belief = started().belief
    table = answer_table(Answer(1.0, belief, EstimatorStatus(), "filter", 1, 0, 0.001), LiveSummary(0.02))
    blocks, spreads = (list(table.columns[k].cells) for k in (0, 2))
    assert "J1/J3, J2/J3" in blocks
    for row, block in enumerate(LAYOUT.members):
        told = np.array(str(spreads[row]).split(), dtype=float)
        np.testing.assert_allclose(told, belief.std[LAYOUT.slice(block.name)], rtol=0.06)
