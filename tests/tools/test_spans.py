"""The time that spans cover, and how many spans overlap."""

from tca_tools.spans import Cover, levels


def test_cover_and_levels_measure_overlapping_spans() -> None:
    spans = [(0.0, 4.0), (1.0, 2.0), (3.0, 6.0), (8.0, 8.0)]
    assert list(levels(spans)) == [(0.0, 1), (1.0, 2), (2.0, 1), (3.0, 2), (4.0, 1), (6.0, 0)]
    one, two = Cover(spans), Cover(spans, 2)
    assert (one.total, two.total) == (6.0, 2.0)
    assert [one.within(*window) for window in ((0, 6), (-5, 1), (5, 9), (3, 3), (7, 8))] == [
        6,
        1,
        1,
        0,
        0,
    ]
    assert (two.within(1.5, 3.5), two.within(9, 1), Cover([]).within(0, 1)) == (1.0, 0.0, 0.0)
