import csv
import re
import subprocess

import pytest

from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.session import evaluate_session
from labcdp.session import Session, example_session


@pytest.fixture(scope="session")
def recorded():
    with Session.open(example_session()) as session:
        yield session


@pytest.fixture(scope="session")
def observed(recorded):
    return observe_session(recorded)


@pytest.fixture(scope="session")
def evaluation(recorded, observed):
    return evaluate_session(recorded, observed, calibrate_session(observed))


@pytest.fixture
def sheets_by_libreoffice(tmp_path):
    """Rows of each sheet as LibreOffice opens them: what is a number there is one here, what is empty is nan."""

    def sheets(workbook):
        # Filter options: comma, quote, UTF-8, from line 1; text in quotes, numbers as they are; all sheets.
        command = [
            *("soffice", f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}", "--headless", "--convert-to"),
            *("csv:Text - txt - csv (StarCalc):44,34,76,1,,0,true,true,false,false,false,-1", "--outdir"),
        ]
        subprocess.run([*command, tmp_path / "sheets", workbook], capture_output=True, timeout=300, check=True)
        found = {}
        for path in (tmp_path / "sheets").iterdir():
            lines = re.sub(r"(?<=,)(?=[,\n])", "nan", path.read_text(encoding="utf-8"))
            lines = re.sub(r"([\d.]+)%(?=[,\n])", lambda share: repr(float(share[1]) / 100), lines)
            rows = csv.reader(lines.splitlines(), quoting=csv.QUOTE_NONNUMERIC)
            found[path.stem.partition("-")[2]] = list(rows)
        return found

    return sheets
