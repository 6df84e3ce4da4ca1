import pytest

from labcdp.regions import GridShape, RectangleShape, new_shapes

KNOWN = (RectangleShape("a", 10, 10, 40, 40), RectangleShape("b", 60, 10, 40, 40))


@pytest.mark.parametrize(("shift_px", "new"), [(0, False), (2, False), (3, True), (40, True), (-40, True)])
def test_regions_coincide_from_nine_tenths_of_their_joint_area_on(shift_px, new):
    # Common to squares of side 40, one of them moved by d: (40 - d) / (40 + d); 0.905 for 2, 0.860 for 3.
    found = RectangleShape("found", 10 + shift_px, 10, 40, 40)
    assert new_shapes((found,), KNOWN[:1]) == ((found,) if new else ())


def test_a_shape_is_there_if_all_its_regions_are():
    grid = GridShape("g", 10, 10, 90, 40, 1, 2, gap=10)
    assert [roi.bounds for roi in grid.rois()] == [shape.rois()[0].bounds for shape in KNOWN]
    assert new_shapes((grid,), KNOWN) == ()
    assert new_shapes((grid,), KNOWN[:1]) == (grid,)
    assert new_shapes(KNOWN, (grid,)) == ()
