"""`labcdp meter`."""

import json
from contextlib import contextmanager

import pytest
from jsonschema import Draft202012Validator

from labcdp.drivers.simulated.meter.meter import MeterErrorModel, PtyMeter, SimulatedLS
from labcdp.report.envelope import schema


@contextmanager
def meter_port(luminance_cd_m2=83.02, **options):
    engine = SimulatedLS(lambda: luminance_cd_m2, errors=MeterErrorModel(repeatability_rel=0.002, seed=3), **options)
    with PtyMeter(engine, response_time_s=0) as port:
        yield port


def test_readings_are_listed_with_mean_and_scatter(labcdp):
    with meter_port() as port:
        done = labcdp("meter", "--meter", port.port, "-n", "3")
    assert done.returncode == 0, done.stderr
    for words in ("mean", "relative scatter", "u of the meter's scale", "1.155"):
        assert words in done.stdout
    assert sum(line.strip("│ ")[:1].isdigit() for line in done.stdout.splitlines()) == 3


def test_readings_as_json(labcdp):
    with meter_port() as port:
        result = json.loads(labcdp("meter", "--meter", port.port, "-n", "4", "--slow", "--peak", "--json").stdout)
    Draft202012Validator(schema()).validate(result)
    readings = result["tables"]["readings"]["rows"]
    values = [reading["value"] for reading in readings]
    assert len(values) == 4
    found = {row["quantity"]: row for row in result["tables"]["series"]["rows"]}
    mean = found["mean"]["value"]
    assert mean == pytest.approx(sum(values) / 4)
    assert found["relative scatter"]["value"] == pytest.approx(found["scatter"]["value"] / mean)
    assert 0 < found["mean"]["u_value"] < 1
    assert all(reading["peak"] for reading in readings)


def test_mistakes_are_one_line(fails):
    assert "there is no such serial port" in fails("meter", "--meter", "/dev/no-such-port")
