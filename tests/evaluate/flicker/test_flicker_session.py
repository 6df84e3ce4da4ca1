"""Flicker of the patches of a session: a pulsed lamp beside steady patches, at two exposure times, by NumPy."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from labcdp import Session
from labcdp.api.session_result import SessionResult
from labcdp.chain import PulsedLamp
from labcdp.core.errors import InputError
from labcdp.evaluate.bench.calibrate import calibrate_recorded
from labcdp.evaluate.bench.flicker import session_flicker
from labcdp.evaluate.bench.session import evaluate_session, observe_calibrated
from labcdp.evaluate.bench.session_result import session_result
from labcdp.evaluate.flicker.page import flicker_section
from labcdp.session.records import frame_times_s

from ..bench.synthetic import START, configuration, frame, record

RATE_HZ, FREQUENCY_HZ, EXPOSURES_S, N_FRAMES, K_DN_PER_E = 25.0, 217.3, (2e-3, 5e-3), 80, 0.5
#: A third exposure time, for the calibration, with few frames.
SHORT_S, N_SHORT = 1e-3, 4
LAMP = PulsedLamp(FREQUENCY_HZ, 0.3, 0.1)
#: Electrons per second at full light of the lamp, and of steady patches, of which one is too bright at 5 ms.
FULL, STEADY = 1.2e6, (5e4, 1e5, 2e5, 4e5, 2e6)
SIDE = 12


def electrons(role, exposure_s, at_s):
    light = np.zeros((2 * SIDE, 20 * (len(STEADY) + 1)))
    if role == "light":
        light[6:18, 4:16] = FULL * LAMP.collected(exposure_s, at_s * FREQUENCY_HZ % 1)
        for index, rate in enumerate(STEADY, start=1):
            light[6:18, 20 * index + 4 : 20 * index + 16] = rate * exposure_s
    return light


def frames():
    rng, number = np.random.default_rng(3), 0
    for role, n in (("light", N_FRAMES), ("dark", 3)):
        for exposure_s in (*EXPOSURES_S, SHORT_S):
            for _ in range(n if exposure_s in EXPOSURES_S else min(n, N_SHORT)):
                at_s = number / RATE_HZ
                light = electrons(role, exposure_s, at_s)
                seen = rng.poisson(light) + rng.normal(0, 8, light.shape)
                dn = np.clip(np.rint(64 + K_DN_PER_E * seen), 0, 4095).astype(np.uint16)
                at = {"timestamp": START + timedelta(seconds=at_s), "camera_timestamp_ns": round(1e9 * (1 + at_s))}
                number += 1
                yield frame(dn, exposure_s, number, **at), role


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    names = ["lamp", *(f"P{index}" for index in range(1, len(STEADY) + 1))]
    rois = {name: [20 * index + 4, 6, SIDE, SIDE] for index, name in enumerate(names)}
    light = dict(zip(names, (1e-4 * FULL * LAMP.mean_level, *(1e-4 * np.array(STEADY))), strict=True))
    path = record(tmp_path_factory.mktemp("flicker") / "session", configuration(rois), frames(), light)
    with Session.open(path) as session:
        # A lamp whose light changes calibrates nothing.
        _, calibration = calibrate_recorded([session], without=["lamp"])
        yield evaluate_session(*observe_calibrated(session, calibration))


@pytest.fixture(scope="module")
def measured(evaluation):
    return {(item.region, item.exposure_s): item for item in session_flicker(evaluation)}


def test_each_exposure_sees_another_flicker(measured):
    for exposure_s in EXPOSURES_S:
        truth, lamp = LAMP.flicker(exposure_s), measured["lamp", exposure_s].flicker
        # Within the noise of frames and the scale of the calibration, which has an offset.
        assert lamp.fmi.value == pytest.approx(truth.fmi, abs=0.02)
        assert lamp.mmp.interval.low - 0.02 < truth.mmp < lamp.mmp.interval.high + 0.02
        assert lamp.n_evaluated == N_FRAMES
        assert lamp.beat_hz == pytest.approx(abs(FREQUENCY_HZ - 9 * RATE_HZ), abs=0.02)
        assert not measured["P1", exposure_s].flicker.flickers
    # What is saturated in all frames is left out.
    assert ("P5", EXPOSURES_S[0]) in measured
    assert ("P5", EXPOSURES_S[1]) not in measured


def test_times_are_those_of_the_clock_of_the_camera(evaluation):
    records = evaluation.observed.session.frames("light")
    times_s = frame_times_s(records)
    assert times_s == pytest.approx([number / RATE_HZ for number in range(2 * N_FRAMES + N_SHORT)], abs=1e-9)
    # A clock that runs at another speed than the computer's counts nothing.
    stamps = [record.metadata | {"camera_timestamp_ns": n} for n, record in enumerate(records, start=1)]
    other = [replace(record, metadata=metadata) for record, metadata in zip(records, stamps, strict=True)]
    assert frame_times_s(other) == [(record.time - records[0].time).total_seconds() for record in records]
    assert frame_times_s([]) == []


def test_files_and_python_have_the_same_numbers(evaluation, measured):
    dataset = SessionResult(evaluation).flicker()
    with_flicker = replace(evaluation, flicker=tuple(measured.values()))
    result = session_result(with_flicker)
    rows = list(result.table("flicker").rows())
    assert [(row["region"], row["exposure_s"]) for row in rows] == list(measured)
    for row in rows:
        cell = dataset.sel(patch=row["region"], exposure_s=row["exposure_s"])
        assert float(cell["fmi"]) == row["fmi"] == measured[row["region"], row["exposure_s"]].flicker.fmi.value
        assert float(cell["mmp_low"]) == row["mmp_low"]
    assert np.isnan(dataset["fmi"].sel(patch="P5", exposure_s=EXPOSURES_S[1]))
    section = flicker_section(with_flicker.flicker, result)
    assert [block.file_name for block in section.blocks[2:]] == ["over-time.png", "over-phase.png"]
    assert "No compliance with IEEE 2020 is claimed" in section.blocks[1]


def test_without_any_light_there_is_no_flicker(evaluation):
    dark = replace(evaluation, patches=[row for row in evaluation.patches if row.patch.name == "P5"])
    assert [item.exposure_s for item in session_flicker(dark)] == [SHORT_S, EXPOSURES_S[0]]
    with pytest.raises(InputError, match="no patch has light in any frame"):
        session_flicker(replace(evaluation, patches=[]))
