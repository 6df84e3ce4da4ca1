import json

from labcdp.session import example_session

from .conftest import results_of, rows_of

#: Fewer patches than the session has, which are quicker.
FEW = [text for i in range(1, 13) if i not in (1, 5) for text in ("--without", f"P{i:02}")]


def test_the_twin_is_written_its_chain_simulated_and_a_calibration_from_a_file_used(labcdp, inputs, tmp_path):
    values = results_of(labcdp("twin", example_session(), "-o", "out", "--json", *FEW))
    (counts,) = values["tables"]["summary"]["rows"]
    assert counts["agreeing"] >= 0.93 * counts["pairs"]
    assert values == json.loads((tmp_path / "out" / "results.json").read_text())
    names = {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*") if p.is_file()}
    assert names - {"labcdp-files.json"} == {
        *("chain.toml", "report.html", "results.xlsx", "results.json", "figures/twin.png")
    }
    rows = rows_of(labcdp("simulate", "out/chain.toml", "-o", "simulated", "--json"), "signal")
    assert {row["stage"] for row in rows} >= {"scene", "optics", "sensor"}

    asked = ("--contrast", "200%", "--epsilon", "30%", "--calibration", inputs / "c/calibration.json")
    done = labcdp("twin", example_session(), "-o", "person", *asked, *FEW)
    assert done.returncode == 0, done.stderr
    assert "pairs" in done.stdout
    assert "Next: labcdp simulate person/chain.toml" in done.stderr
    values = json.loads((tmp_path / "person" / "results.json").read_text())
    assert [one["role"] for one in values["inputs"]] == ["session", "calibration"]
    facts = {row["item"]: row["value"] for row in values["tables"]["provenance"]["rows"]}
    assert facts["SHA-256 of those of the calibration"] == "0" * 64 != facts["SHA-256 of frames and readings"]
