"""The study of comparisons in threads: which recordings meet, and its counts."""

from experiments.thread_safety import KINDS, ThreadedRuns, recording_of, runs_of


def test_every_recording_meets_itself_and_every_other() -> None:
    met = {tuple(sorted((recording_of(run, 0), recording_of(run, 1)))) for run in range(2 * len(KINDS))}
    assert met == {(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)}


def test_a_run_with_other_numbers_or_an_error_is_counted_and_named() -> None:
    alone = ["a", "b", "c"]
    found = runs_of([["a", "a"], ["b", "ValueError('x')"], ["c", "d"]], alone)
    assert found.alike == 1
    assert found.different == (
        "run 1, thread 1, stereo-tracks: ValueError('x')",
        "run 2, thread 1, stereo-tracks: d",
    )
    assert not found.is_clean


def test_runs_of_a_process_that_ended_early_are_missing() -> None:
    both = ThreadedRuns(alike=3) + ThreadedRuns(missing=2, ended=("exit code -11: ",))
    assert (both.alike, both.missing, both.is_clean) == (3, 2, False)
