"""Spectral sensitivities in `labcdp info`: f1' and mismatch factors."""

import json

import pytest

from labcdp.core.photometry import spectral_weights

NM, _, V = spectral_weights("E")


@pytest.fixture
def sensitivity(tmp_path):
    rows = [f"{nm:g},{v:.9g}" for nm, v in zip(NM, V, strict=True)]
    (tmp_path / "v.csv").write_text("\n".join(["wavelength_nm,V", *rows]), encoding="utf-8")
    return "v.csv"


def test_v_lambda_needs_no_correction(labcdp, sensitivity):
    tables = json.loads(labcdp("info", sensitivity, "--json").stdout)["tables"]
    assert next(row["value"] for row in tables["properties"]["rows"] if row["property"] == "f1'").startswith("0.00%")
    factors = {row["light"]: row["factor"] for row in tables["mismatch"]["rows"]}
    assert set(factors) >= {"A", "D65", "LED-B1", "LED-B4", "FL11"}
    assert all(abs(factor - 1) < 1e-8 for factor in factors.values())


def test_a_camera_with_filters_gets_weights(labcdp, tmp_path):
    rows = [
        f"{nm:g},{v * (nm > 560):.9g},{v * (nm <= 560):.9g},{float(nm < 480):g}" for nm, v in zip(NM, V, strict=True)
    ]
    (tmp_path / "rgb.csv").write_text("\n".join(["wavelength_nm,R,G,B", *rows]), encoding="utf-8")
    tables = json.loads(labcdp("info", "rgb.csv", "--source", "LED-B4", "--json").stdout)["tables"]
    values = {row["property"]: row["value"] for row in tables["properties"]["rows"]}
    assert (values["f1'"][:5], values["weight of R"], values["weight of G"]) == ("0.00%", "1", "1")
    assert "LED-B4" in tables["mismatch"]["title"]


def test_a_measured_light_can_be_given(labcdp, tmp_path, sensitivity):
    (tmp_path / "lamp.csv").write_text("\n".join(["wavelength_nm,power", *(f"{nm:g},1" for nm in NM)]))
    assert "lamp.csv" in labcdp("info", sensitivity, "--source", "lamp.csv").stdout


def test_mistakes_are_one_line(fails, sensitivity):
    assert "none.csv does not exist" in fails("info", "none.csv")
    line = fails("info", sensitivity, "--source", "candle")
    assert line.startswith("labcdp: --source: spectrum is 'candle', which is not known")
    assert "or a CSV file; lights by name: " in line
