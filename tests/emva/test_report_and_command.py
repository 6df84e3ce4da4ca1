import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from labcdp.calibration.emva import Quantity, characterise_data_set
from labcdp.report import characterisation_table, write_characterisation
from labcdp.report.characterise_spatial_plots import amplitude_spectrum, high_pass
from labcdp.report.characterise_tables import plain_words, short, shown
from labcdp.session import example_session

LABCDP = Path(sys.executable).with_name("labcdp")


@pytest.fixture(scope="module")
def found(data_set):
    return characterise_data_set(data_set)


@pytest.fixture(scope="module")
def written(found, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    write_characterisation(found, folder)
    return folder


def run(*arguments, cwd):
    return subprocess.run([LABCDP, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=120)


def test_all_plots_of_the_standard_are_written(written):
    names = {path.name for path in (written / "figures").iterdir()}
    assert names == {
        f"characterise-{name}.png"
        for name in (
            *("photon-transfer", "sensitivity", "linearity", "snr", "dark-current"),
            *("histogram", "accumulated", "spectrogram", "profile"),
        )
    }


def test_the_page_needs_nothing_else_and_claims_no_compliance(written):
    page = (written / "characterisation.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 9
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert "after EMVA 1288 Release 3.1" in page
    assert "not a declaration of compliance" in page
    assert "the converter ends the range" in page


def test_the_numbers_are_those_of_the_result(written, found):
    values = json.loads((written / "characterisation.json").read_text())
    assert values["k_dn_per_e"] == found.k_dn_per_e.to_dict()
    book = openpyxl.load_workbook(written / "characterisation.xlsx")
    assert book.sheetnames == ["Summary", "Series", "Darkness", "Provenance"]
    rows = {row[0]: row for row in book["Summary"].iter_rows(values_only=True)}
    k = found.k_dn_per_e
    assert rows["Overall system gain K"][1:3] == pytest.approx((k.value, k.standard_uncertainty), rel=1e-14)
    assert rows["PRNU"][1] == pytest.approx(100 * found.prnu_rel.value)
    assert book["Series"].max_row == 1 + len(found.series)


def test_the_table_shows_two_digits_of_the_uncertainty(found):
    rows = {row[0]: row[1:] for row in characterisation_table(found).rows}
    value, unit = rows["Overall system gain K"]
    assert unit == "DN/e⁻"
    assert re.fullmatch(r"0\.\d+ ± 0\.0+[1-9]\d", value)
    assert shown(1.5, float("nan")) == "1.500 ± unknown"
    assert short(Quantity(14007.8, 130.0, "e-")) == "14000"


def test_plain_words_tell_what_ends_the_range(found):
    words = " ".join(plain_words(found))
    assert "then the converter ends, not the pixel" in words
    assert re.search(r"One electron makes 0\.2[45]\d* DN, and (49|50|51)(\.\d)? % of the photons", words)


def test_spectrum_of_white_noise_is_its_standard_deviation():
    noise = 3.0 * np.random.default_rng(1).standard_normal((2000, 128))
    spectrum = amplitude_spectrum(noise)
    # The power has a relative standard deviation of 1 / sqrt(rows), twice as much at the ends; 5 of them.
    assert spectrum == pytest.approx(3.0, rel=5 * np.sqrt(2 / 2000) / 2)


def test_a_periodic_pattern_is_a_peak_at_its_frequency():
    spectrum = amplitude_spectrum(np.tile([0.0, 1.0, 0.0, -1.0], (50, 32)))
    assert np.argmax(spectrum) / 128 == 0.25


def test_high_pass_takes_off_gradients():
    rows, columns = np.indices((40, 50))
    assert np.allclose(high_pass(2.0 * rows + 3.0 * columns)[2:-2, 2:-2], 0)


def test_the_command_takes_an_index(data_set, tmp_path):
    done = run("characterise", data_set, "-o", "out", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["k_dn_per_e"]["value"] == pytest.approx(0.25, rel=0.05)
    assert values["output"] == "out"
    assert (tmp_path / "out" / "characterisation.html").exists()


def test_the_command_takes_a_session(tmp_path):
    done = run("characterise", example_session(), "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Simulated: camera Allied Vision" in done.stderr
    assert "Responsivity R" in done.stdout
    assert "Warning: the converter ends the range" in done.stderr
    page = (tmp_path / "out" / "characterisation.html").read_text(encoding="utf-8")
    assert "Simulated camera" in page


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("nowhere", r"nowhere does not exist: give a session, or the index of a data set"),
        ("empty", r"empty holds neither a session nor EMVA1288_Data\.txt: give a session or a data set"),
        ("bad.txt", r"bad\.txt, line 1: 'hello' begins with none of the letters"),
    ],
)
def test_mistakes_are_one_line(tmp_path, path, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad.txt").write_text("hello\n")
    done = run("characterise", path, cwd=tmp_path)
    assert done.returncode == 1
    assert re.fullmatch(rf"labcdp: {message}.*\n", done.stderr)
    assert not list(tmp_path.glob("*-characterisation"))
