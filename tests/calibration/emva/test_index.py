from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration.emva.index import INDEX_NAME, load_index, parse_index
from labcdp.core.errors import InputError

HEAD = "v 3.1\nn 12 64 48\n"
GOOD = HEAD + "b 1e6 100\ni a.png\ni b.png\nb 2e6 200\ni c.png\ni d.png\nd 1e6\ni e.png\ni f.png\n"
PATH = Path("set") / INDEX_NAME


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("b 1e6 100", "x 1e6 100", r"line 3: 'x 1e6 100' starts with none of the letters v, n, b, d, i and #"),
        ("b 1e6 100", "b -1 100", r"line 3: the exposure is -1 ns: give a time from 0 ns to a day"),
        ("n 12 64 48\n", "", r"there is no line n"),
        ("i b.png\n", "", r"line 3: there are 1 images: give at least 2"),
        ("b 2e6 200", "b 1e6 100", r"line 6: the same exposure as in line 3: keep one of the two"),
    ],
)
def test_mistakes_are_reported_with_file_and_line(tmp_path, old, new, message):
    (tmp_path / INDEX_NAME).write_text(GOOD.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"EMVA1288_Data\.txt.*{message}"):
        load_index(tmp_path)


blocks = st.tuples(st.floats(1, 1e12), st.floats(0, 1e9), st.integers(2, 4))


@given(st.lists(blocks, min_size=2, max_size=6, unique_by=lambda b: b[0]))
def test_what_is_written_is_read(written):
    lines = [HEAD]
    for number, (exposure_ns, photons, count) in enumerate(written):
        for letter, values in (("b", f"{exposure_ns!r} {photons!r}"), ("d", f"{exposure_ns!r}")):
            lines.append(f"{letter} {values}\n")
            lines += [f"i {letter}{number}_{image}.png\n" for image in range(count)]
    index = parse_index("".join(lines), PATH)
    bright = [(b.exposure_ns, b.photons, len(b.images)) for b in index.blocks if b.kind == "bright"]
    assert bright == written
    assert [b.exposure_ns for b in index.blocks if b.kind == "dark"] == [b[0] for b in written]
    assert (index.bits, index.width, index.height) == (12, 64, 48)
    assert index.blocks[0].images[0] == Path("set/b0_0.png")
