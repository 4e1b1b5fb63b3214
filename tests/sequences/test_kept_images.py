"""Images that are kept: the same bytes, each decoded once, never more than allowed."""

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences.image_source import KeptImages

SIZE = (40, 30)
BYTES = 30 * 40 * 3


class Counted:
    """Five images; counts how often each is read."""

    names = tuple(f"{i}.png" for i in range(5))

    def __init__(self):
        self.read_counts, self.digest_counts = [0] * 5, 0

    def __len__(self):
        return 5

    def read(self, index, size):
        self.read_counts[index] += 1
        if size not in (None, SIZE):
            raise SequenceError("another size")
        return np.full((30, 40, 3), index, np.uint8)

    def digests(self):
        self.digest_counts += 1
        return self.names

    def part(self, indices):
        found = Counted()
        found.names = tuple(self.names[i] for i in indices)
        return found


@pytest.mark.parametrize(("fits", "read_counts"), [(5, [1, 1, 1, 1, 1]), (2, [1, 1, 3, 3, 3]), (0, [3] * 5)])
def test_each_image_that_fits_is_read_once(fits, read_counts):
    source = Counted()
    kept = KeptImages(source, fits * BYTES + 1)
    for _ in range(3):
        for index in range(5):
            assert (kept.read(index, SIZE) == index).all()
    assert source.read_counts == read_counts
    assert (len(kept), kept.names, kept.digests()) == (5, source.names, source.names)


def test_what_is_kept_cannot_be_changed_and_another_size_is_still_refused():
    kept = KeptImages(Counted(), 10 * BYTES)
    image = kept.read(3, SIZE)
    with pytest.raises(ValueError, match="read-only"):
        image[0, 0] = 9
    with pytest.raises(SequenceError, match="another size"):
        kept.read(3, (10, 10))


def test_digests_are_made_once_for_parts_too():
    source = Counted()
    kept = KeptImages(source, 0)
    assert kept.part([3]).digests() == ("3.png",)  # of the part alone, as nobody has asked for all
    assert source.digest_counts == 0
    for _ in range(2):
        assert kept.digests() == source.names
    part = kept.part([4, 1])
    assert part.digests() == ("4.png", "1.png")
    assert (source.digest_counts, part.source.digest_counts) == (1, 0)
