"""Cells of the table of mixtures: coverage and score of a mixture against those of one Gaussian."""

from experiments.lasting_errors import mixture_cells


def test_a_mixture_is_narrower_in_the_middle_than_the_gaussian_that_covers_it() -> None:
    rows = [{"rate": [[error, 2.0, [0.9, 0.1], [1.0, 3.0]]] * 3} for error in (-1.5, -0.5, 0.4, 1.2)]
    one, both = (mixture_cells(rows, is_mixture).split(" | ") for is_mixture in (False, True))
    assert one[:3] == ["75%", "100%", "100%"]
    assert both[:3] == ["50%", "75%", "100%"]
    assert float(both[-1]) < float(one[-1])
