import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import labcdp.metrics

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "metrics.md").read_text()


def test_examples_print_what_is_next_to_them():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    expected = [line.rsplit("# ", 1)[1] for line in block.splitlines() if line.startswith("print") and "# " in line]
    output = StringIO()
    with redirect_stdout(output):
        exec(block, {})
    printed = output.getvalue().splitlines()
    assert len(printed) == 6
    assert [printed[0], printed[3]] == expected


def test_functions_it_names_exist():
    named = set(re.findall(r"`([a-z_0-9]+)[(`]", PAGE))
    assert named
    fields = set(labcdp.metrics.DetectionProbability.__annotations__)
    assert named <= set(labcdp.metrics.__all__) | fields
