import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "metrics.md").read_text()


def test_examples_print_what_is_next_to_them():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    output = StringIO()
    with redirect_stdout(output):
        exec(block, {})
    lines = [line for line in block.splitlines() if line.startswith("print")]
    printed = dict(zip(lines, output.getvalue().splitlines(), strict=True))
    said = {line: line.rsplit("# ", 1)[1] for line in lines if "# " in line}
    assert len(said) >= 2
    assert {line: printed[line] for line in said} == said
