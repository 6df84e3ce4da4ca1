import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "metrics.md").read_text()


def test_examples_print_what_is_next_to_them():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    with redirect_stdout(StringIO()) as output:
        exec(block, {})
    lines = [line for line in block.splitlines() if line.startswith("print")]
    both = zip(lines, output.getvalue().splitlines(), strict=True)
    said = [(line.split("# ")[1], printed) for line, printed in both if "# " in line]
    assert len(said) >= 2
    assert all(one == printed for one, printed in said)
