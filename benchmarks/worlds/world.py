"""Worlds: what a camera, its lens, the light and the meter may do, one effect at a time and several together."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

#: Pixels of the sensor, and full scale of its 12 bits.
HEIGHT, WIDTH = 96, 128
FULL_SCALE_DN = 4095
PITCH_M, FOCAL_LENGTH_M = 5e-6, 1.5e-3
#: Change of temperature that doubles the dark current.
DOUBLING_K = 7.0
BRIGHTEST_CD_M2 = 500.0
#: Signal of the brightest patch at the shortest exposure, as a share of the range above black.
BRIGHTEST_SHARE = 0.6


@dataclass(frozen=True)
class World:
    """Parameters of a world; the defaults are the ideal one, which the fitted model describes exactly.

    Parameters
    ----------
    name : str
        Name in the table; with a number, the seed of a calibration.
    names : tuple of str
        Codes of labcdp's findings that name the effect; a code also stands for those that begin with it.
    full_well_e, k_dn_per_e, black_dn, read_noise_e, dark_current_e_s : float
        Camera, EMVA 1288; `k_dn_per_e` is the overall system gain.
    prnu_rel, dsnu_e : float
        Standard deviations of the fixed pattern of sensitivity and of dark signal.
    column_dn, row_dn : float
        Standard deviations of a fixed offset for each column, and of one for each row and frame.
    black_drift_dn : float
        Standard deviation of the black level from frame to frame.
    cubic : float
        Share by which the response falls below a straight line at full scale, as the cube of the signal.
    gamma : float
        Exponent of the tone curve, black level included.
    bayer : bool
        Whether the sensor has colour filters (RGGB).
    coloured : float
        Share of the patches that are coloured, in the calibration and after; no weights of the filters equal V(lambda).
    vignetting : {'cos4', 'near cos4', 'lens'}
        Of the lens: cos^4; cos^4 but for 5 % in the corners (standard deviation over lenses); or falling faster, off
        centre, by mechanical vignetting too.
    correction : {'none', 'cos4', 'flat'}
        What the user takes: nothing, the lens' cos^4, or a flat field with a source uniform to `nonuniformity_rel`.
    nonuniformity_rel : float
        Standard deviation of the flat field's source, as the user states it.
    bracket : bool
        Whether the user takes the response from the exposures as a bracket.
    glare_rel : float
        Share of the mean light of the image that is spread evenly over it.
    scatter_rel : float
        Standard deviation between the light that camera and meter receive from a patch.
    flicker_rel : float
        Standard deviation of the lamp from frame to frame.
    flicker_period_s : float
        Exposures that are longer see as much less of it.
    drift_rel : float
        Loss of the lamp from the first frame to the end of the calibration.
    lamp_step_rel : float
        Standard deviation of a change of the lamp at once, after all frames and half the readings.
    drift_spread_rel : float
        Standard deviation of that loss over the calibrations, as labcdp takes for granted.
    breathing_rel : float
        Standard deviation of the responsivity after focusing anew between calibration and use.
    scale_half_width_rel : float
        Bound of the meter's scale error, stated and true (rectangular).
    resolution_cd_m2, digits, repeatability_rel : float
        Last digit of the meter, bound of its error in digits, and repeatability.
    readings : int
        Readings of each patch.
    wrong_reading_rel : float
        Error of one of all readings.
    recalibrated : {'', 'stated', 'not stated'}
        Whether the meter is readjusted after half the patches, and whether the readings say so.
    patches : int
        Patches of the calibration, up to 16.
    exposures_s : tuple of float
        Exposure times.
    darkest_cd_m2 : float
        Luminance of the darkest patch.
    gradient_rel : float
        Change of the light across each patch, from edge to edge, in a random direction; in both sessions.
    hot_spot_rel : float
        How much brighter the middle of each patch is than its edge; the meter sees the middle third, in both sessions.
    exposure_offset_s : float
        Added to each exposure time by the camera, which does not say so.
    temperature_c : float
        Of the camera.
    stated_temperature : bool
        Whether frames state the camera's temperature.
    later : tuple of (str, float)
        What is otherwise in the session that is evaluated: names of these parameters and their values, and
        ``warmer_k``, the standard deviation of the camera's temperature from that of the calibration (its dark current
        doubles every 7 K), and ``black_shift_dn``, that of its black level.
    """

    name: str = "ideal"
    names: tuple[str, ...] = ()
    full_well_e: float = 12_000.0
    k_dn_per_e: float = 0.4
    black_dn: float = 64.0
    read_noise_e: float = 4.0
    dark_current_e_s: float = 5.0
    prnu_rel: float = 0.0
    dsnu_e: float = 0.0
    column_dn: float = 0.0
    row_dn: float = 0.0
    black_drift_dn: float = 0.0
    cubic: float = 0.0
    gamma: float = 1.0
    bayer: bool = False
    coloured: float = 0.0
    vignetting: Literal["cos4", "near cos4", "lens"] = "cos4"
    correction: Literal["none", "cos4", "flat"] = "cos4"
    nonuniformity_rel: float = 0.005
    bracket: bool = False
    glare_rel: float = 0.0
    scatter_rel: float = 0.0
    flicker_rel: float = 0.0
    flicker_period_s: float = inf
    drift_rel: float = 0.0
    lamp_step_rel: float = 0.0
    drift_spread_rel: float = 0.0
    breathing_rel: float = 0.0
    scale_half_width_rel: float = 0.002
    resolution_cd_m2: float = 1e-5
    digits: int = 1
    repeatability_rel: float = 0.002
    readings: int = 3
    wrong_reading_rel: float = 0.0
    recalibrated: Literal["", "stated", "not stated"] = ""
    patches: int = 10
    exposures_s: tuple[float, ...] = (1e-3, 1e-2, 1e-1)
    darkest_cd_m2: float = 0.5
    gradient_rel: float = 0.0
    hot_spot_rel: float = 0.0
    exposure_offset_s: float = 0.0
    temperature_c: float = 30.0
    stated_temperature: bool = True
    later: tuple[tuple[str, float], ...] = ()


_FIVE_EXPOSURES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
_BRACKET = tuple(1e-3 * 2**i for i in range(8))
_VIGNETTING = ("vignetting-",)
_EXPOSURES = ("exposures-scatter", "exposure-deviates", "exposures-offset")
_READINGS = ("reading-contradicts", "patch-contradicts", "readings-scatter")

WORLDS = (
    World(),
    World("patch scatter 0.3 %", ("patches-scatter",), scatter_rel=0.003),
    World("patch scatter 1 %", ("patches-scatter",), scatter_rel=0.01),
    World("patch scatter 1 %, 8 patches, 4 exposures", ("patches-scatter",), scatter_rel=0.01, patches=8,
          exposures_s=(1e-3, 5e-3, 2e-2, 1e-1)),
    World("lamp flicker 1 %", ("flicker", *_EXPOSURES), flicker_rel=0.01),
    World("lamp drift 1 %", ("drift",), drift_rel=0.01),
    World("lamp drift 3 %", ("drift",), drift_rel=0.03),
    World("dark current 100 e-/s, 1 ms to 1 s", dark_current_e_s=100, exposures_s=(1e-3, 1e-2, 1e-1, 1.0),
          darkest_cd_m2=0.1),
    World("dark current 2000 e-/s, 1 ms to 1 s", dark_current_e_s=2000, exposures_s=(1e-3, 1e-2, 1e-1, 1.0),
          darkest_cd_m2=0.1),
    World("black-level drift 0.1 DN", ("exposures-scatter-dn",), black_drift_dn=0.1),
    World("PRNU 1 %", prnu_rel=0.01),
    World("PRNU 1 %, flat field", prnu_rel=0.01, correction="flat"),
    World("DSNU 5 e-", dsnu_e=5.0),
    World("column and row noise 0.5 DN", column_dn=0.5, row_dn=0.5),
    World("glare 0.5 %", ("intercept",), glare_rel=0.005),
    World("vignetting, no correction", _VIGNETTING, vignetting="lens", correction="none"),
    World("vignetting, cos4", _VIGNETTING, vignetting="lens"),
    World("vignetting 5 % beside cos4", _VIGNETTING, vignetting="near cos4"),
    World("vignetting, flat field", _VIGNETTING, vignetting="lens", correction="flat"),
    World("vignetting, flat field, gamma 2.2", _VIGNETTING, vignetting="lens", correction="flat", gamma=2.2),
    World("refocusing 0.5 %", breathing_rel=0.005),
    World("cubic response 1 %", cubic=0.01),
    World("gamma 2.2", gamma=2.2),
    World("gamma 2.2, bracket", gamma=2.2, bracket=True, exposures_s=_BRACKET, drift_spread_rel=0.01),
    World("gamma 2.2, bracket, glare 0.5 %", ("intercept",), gamma=2.2, bracket=True, exposures_s=_BRACKET,
          drift_spread_rel=0.01, glare_rel=0.005),
    World("meter scale 2 %", scale_half_width_rel=0.02),
    World("meter digits", resolution_cd_m2=0.01, digits=2),
    World("one wrong reading of three, 20 %", _READINGS, wrong_reading_rel=0.2),
    World("one wrong reading of one, 20 %", _READINGS, wrong_reading_rel=0.2, readings=1),
    World("recalibrated meter", ("meter-recalibrated",), scale_half_width_rel=0.02, recalibrated="stated"),
    World("recalibrated meter, not stated", ("readings-step",),
          scale_half_width_rel=0.02, recalibrated="not stated"),
    World("lamp step 1 %, meter scale 2 %", ("readings-step",), scale_half_width_rel=0.02, lamp_step_rel=0.01),
    World("4 patches", patches=4),
    World("8 patches", patches=8),
    World("16 patches", patches=16),
    World("1 exposure", exposures_s=(1e-3,), darkest_cd_m2=10.0),
    World("5 exposures", exposures_s=_FIVE_EXPOSURES),
    World("Bayer", bayer=True),
    World("Bayer, 4 patches", bayer=True, patches=4),
    World("Bayer, coloured patches", ("colours-do-not-fit",), bayer=True, coloured=0.5, patches=16),
    World("together", ("patches-scatter", *_EXPOSURES, *_VIGNETTING, "intercept"), scatter_rel=0.003,
          flicker_rel=0.002, drift_rel=0.002, dark_current_e_s=100.0, black_drift_dn=0.1, prnu_rel=0.005, dsnu_e=2.0,
          column_dn=0.2, row_dn=0.2, vignetting="lens", correction="flat", glare_rel=0.0002, breathing_rel=0.002,
          cubic=0.01, scale_half_width_rel=0.02, resolution_cd_m2=0.01, digits=2, exposures_s=_FIVE_EXPOSURES),
    # What the session that is evaluated brings with it, and what the calibration did not.
    World("later: lamp flicker 1 %", later=(("flicker_rel", 0.01),)),
    World("later: pulsed lamp, 20 %", ("flicker", *_EXPOSURES), later=(("flicker_rel", 0.2),)),
    World("later: pulsed lamp, 20 % at 1 ms, 0.2 % at 100 ms", ("flicker", *_EXPOSURES),
          later=(("flicker_rel", 0.2), ("flicker_period_s", 1e-3))),
    World("pulsed lamp, 20 % at 1 ms, 0.2 % at 100 ms", ("flicker", *_EXPOSURES), flicker_rel=0.2,
          flicker_period_s=1e-3),
    World("later: steady lamp, flicker 5 % before", _EXPOSURES, flicker_rel=0.05, later=(("flicker_rel", 0.0),)),
    World("later: black level 1 DN", ("dark-", "black"), later=(("black_shift_dn", 1.0),)),
    World("later: black-level drift 0.5 DN", ("dark-", "black", *_EXPOSURES), later=(("black_drift_dn", 0.5),)),
    World("later: 5 K warmer, 100 e-/s", ("dark-", "temperature"), dark_current_e_s=100.0, darkest_cd_m2=0.1,
          exposures_s=(1e-3, 1e-2, 1e-1, 1.0), later=(("warmer_k", 5.0),)),
    World("later: 5 K warmer, not stated, 100 e-/s", ("dark-", "temperature"), dark_current_e_s=100.0,
          darkest_cd_m2=0.1, exposures_s=(1e-3, 1e-2, 1e-1, 1.0), stated_temperature=False, later=(("warmer_k", 5.0),)),
    World("gradient 3 % in each patch", gradient_rel=0.03),
    World("gradient 3 % in each patch, scatter 0.3 %", ("patches-scatter",), gradient_rel=0.03, scatter_rel=0.003),
    World("hot spot 5 % in each patch, meter sees a third", ("patch-shape",), hot_spot_rel=0.05,
          later=(("hot_spot_rel", 0.0),)),
    World("exposures 50 µs longer than stated", _EXPOSURES, exposure_offset_s=50e-6),
)  # fmt: skip
