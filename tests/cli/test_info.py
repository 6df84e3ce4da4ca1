"""labcdp info: every file that labcdp writes or reads is named, and damaged ones say so."""

import hashlib
import json

import openpyxl
import pytest

from labcdp.cli.app import app
from labcdp.core.errors import InputError


@pytest.fixture(scope="module")
def results(inputs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("info")
    app(["simulate", str(inputs / "small.toml"), "--exact", "--output", str(folder / "out")], standalone_mode=False)
    (folder / "readings.csv").write_text("patch,luminance_cd_m2\nwhite,30.1\nwhite,30.2\n")
    return folder


def info(capsys, path):
    capsys.readouterr()
    app(["info", str(path), "--json"], standalone_mode=False)
    rows = json.loads(capsys.readouterr().out)["tables"]["properties"]["rows"]
    return {row["property"]: row["value"] for row in rows}


def test_every_file_of_results_is_named(results, inputs, capsys):
    kinds = {
        "out": "folder of results",
        "out/results.json": "results",
        "out/results.xlsx": "spreadsheet of results",
        "out/report.html": "page of results",
        "out/labcdp-files.json": "list of the files of results",
        "readings.csv": "meter readings",
    }
    assert {name: info(capsys, results / name)["kind"] for name in kinds} == kinds
    assert info(capsys, inputs / "s/journal.jsonl")["kind"] == "journal of a session"
    assert info(capsys, inputs / "c/certificate.html")["kind"] == "page of results"
    assert info(capsys, inputs / "c/observations.json")["kind"] == "observations kept beside a calibration"
    assert info(capsys, results / "readings.csv")["readings of white"] == "2"
    calibration = inputs / "c/calibration.json"
    shown = info(capsys, calibration)
    assert shown["number"] == json.loads(calibration.read_text())["number"]
    assert shown["SHA-256 of the file"] == hashlib.sha256(calibration.read_bytes()).hexdigest()


@pytest.mark.parametrize("damage", [{"tables": None}, {"tables": {"a": {}}}, {"inputs": 3}, {"kind": []}])
def test_incomplete_results_are_called_damaged(results, tmp_path, damage):
    content = json.loads((results / "out/results.json").read_text())
    (tmp_path / "results.json").write_text(json.dumps(content | damage))
    with pytest.raises(InputError, match=r"results\.json is not as labcdp writes results"):
        app(["info", str(tmp_path / "results.json")], standalone_mode=False)
    name = next(iter(content["tables"]))
    content["tables"][name]["rows"][0].popitem()
    (tmp_path / "results.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="rows that do not fit its columns"):
        app(["info", str(tmp_path / "results.json")], standalone_mode=False)


@pytest.mark.parametrize("name", ["a.xlsx", "a.html", "a.jsonl", "sweep.jsonl"])
def test_files_of_others_are_refused(tmp_path, name):
    for content in (b"", b"PK\x03\x04", b"<html></html>"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=name):
            app(["info", str(tmp_path / name)], standalone_mode=False)


def test_spreadsheets_of_others_are_readings_or_spectra_or_refused(tmp_path, capsys):
    book = openpyxl.Workbook()
    for row in (["May"], ["patch", "luminance (cd/m²)"], ["white", 30.1], ["white", 30.2]):
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    found = info(capsys, tmp_path / "a.xlsx")
    assert (found["kind"], found["readings of white"]) == ("meter readings", "2")
    book.active["B4"] = "30,2"
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r"a\.xlsx, Sheet!B4: '30,2' is text, not a number"):
        info(capsys, tmp_path / "a.xlsx")
    book.active["A2"] = "place"
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r"no such table in its sheets \(Sheet\): give meter readings"):
        info(capsys, tmp_path / "a.xlsx")


def spectrum(folder, wavelengths_nm, header="wavelength_nm,relative"):
    """A smooth sensitivity that vanishes at 380 and 780 nm, at some wavelengths."""
    n_columns = header.count(",")
    values = [max(1 - ((nm - 580) / 200) ** 2, 0.0) for nm in wavelengths_nm]
    lines = (
        ",".join([f"{nm}", *[f"{value:.6f}"] * n_columns]) for nm, value in zip(wavelengths_nm, values, strict=True)
    )
    (folder / "spectrum.csv").write_text("\n".join([header, *lines]))
    return folder / "spectrum.csv"


def not_known(capsys, path):
    return [text for name, text in info(capsys, path).items() if name.startswith("not known")]


def test_what_a_spectrum_leaves_open_is_listed(tmp_path, capsys):
    """At all wavelengths only the kind of values and of the spectrum is open; ends and gaps come on top."""
    whole = not_known(capsys, spectrum(tmp_path, range(380, 781, 5)))
    assert len(whole) == 3
    assert len(not_known(capsys, spectrum(tmp_path, range(380, 781, 5), "wavelength_nm,R,G,B"))) == 2
    cut = not_known(capsys, spectrum(tmp_path, range(385, 776, 5)))
    assert set(whole) < set(cut)
    assert [text.partition(":")[0] for text in cut if text not in whole] == ["below 385 nm", "above 775 nm"]
    # 1 - (195 / 200)^2 of the maximum is left at both ends.
    assert all("4.9%" in text for text in cut if text not in whole)
    (gap,) = set(not_known(capsys, spectrum(tmp_path, [*range(380, 501, 5), *range(540, 781, 5)]))) - set(whole)
    assert "500 to 540 nm" in gap
