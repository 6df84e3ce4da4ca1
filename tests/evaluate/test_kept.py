import numpy as np

from labcdp.evaluate.kept import kept_by_mask


def test_a_mask_is_asked_for_once_and_told_from_others():
    asked = []

    @kept_by_mask
    def pixels(mask):
        asked.append(mask.shape)
        return mask.shape, int(mask.sum())

    flat = np.arange(12) % 3 == 0
    masks = [flat.reshape(3, 4), flat.reshape(4, 3), ~flat.reshape(3, 4), flat.reshape(4, 3).T]
    for _ in range(2):
        assert [pixels(mask) for mask in masks] == [((3, 4), 4), ((4, 3), 4), ((3, 4), 8), ((3, 4), 4)]
    assert asked == [(3, 4), (4, 3), (3, 4), (3, 4)]


def test_a_mask_that_is_changed_is_another():
    mask = np.ones((2, 3), dtype=bool)
    count = kept_by_mask(lambda marked: int(marked.sum()))
    assert count(mask) == 6
    mask[0, 0] = False
    assert count(mask) == 5


def test_large_masks_are_not_remembered():
    asked = []
    count = kept_by_mask(lambda mask: asked.append(mask.size))
    large = np.ones((512, 512), dtype=bool)
    count(large)
    count(large)
    assert asked == [large.size] * 2
