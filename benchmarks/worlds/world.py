"""A world: what a camera, its lens, the light and the meter may do."""

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
#: Time constant of a camera that warms up, in the first hour: a third of it.
WARM_UP_S = 1200.0
BRIGHTEST_CD_M2 = 500.0
#: Signal of the brightest patch at the shortest exposure, as a share of the range above black.
BRIGHTEST_SHARE = 0.6


@dataclass(frozen=True)
class Captured:
    """A capture of a sensor that merges several.

    Parameters
    ----------
    light : float
        Electrons over those of the first capture.
    k_dn_per_e, full_well_e, read_noise_e : float
        Its readout.
    """

    light: float
    k_dn_per_e: float
    full_well_e: float
    read_noise_e: float


#: Large photodiode at two gains and a small one: electrons published by J. Solhusvik and others, International Image
#: Sensor Workshop 2019, R32; converters that end where they do in the preset split-pixel.
SPLIT_PIXEL = (
    Captured(1.0, 0.748, 22_000.0, 0.83),
    Captured(1.0, 0.183, 22_000.0, 3.05),
    Captured(0.01, 0.510, 7_900.0, 0.83),
)


@dataclass(frozen=True)
class World:
    """Parameters of a world; the defaults are the ideal one, which the fitted model describes exactly.

    Parameters
    ----------
    name : str
        Name in the table; with a number, the seed of a calibration.
    causes : tuple of str
        What is special, by the names of `causes`: a finding that names one of them is right, of another one false.
    full_well_e, k_dn_per_e, black_dn, read_noise_e, dark_current_e_s : float
        Camera, EMVA 1288; `k_dn_per_e` is the overall system gain.
    captures : tuple of Captured
        Captures that the sensor merges inside, most sensitive first; none for one of the values above. `k_dn_per_e`
        is that of the first.
    coded : bool
        Whether the merged value comes in 12 bits by the curve of AR0231, which the frames state; else in 20 bits.
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
    knees : tuple of (float, float)
        Shares of full scale above black from which the response has another slope, relative to that at black: a
        companding sensor, or two readouts of different gain that are joined. No file states them.
    converters : {'', 'columns', 'halves'}
        Whether even and odd columns, or the halves of the image, have converters of their own.
    converters_rel : float
        Difference of their gains.
    image_lag_rel : float
        Share of the charge that stays for the next frame. The camera runs freely, so that only the first frame of an
        exposure follows one of another; before the dark frames it has run in the dark.
    longest_first : bool
        Whether the light frames begin with the longest exposure.
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
    blur_px : float
        Radius of the disc that a defocused lens makes of a point.
    halo_rel, halo_px : float
        Share of a point's light that goes to a halo around it, and its standard deviation.
    light_offset_dn : float
        Black level of light frames above that of dark frames.
    scatter_rel : float
        Standard deviation between the light that camera and meter receive from a patch.
    flicker_rel : float
        Standard deviation of the lamp from frame to frame.
    flicker_period_s : float
        Exposures that are longer see as much less of it.
    ripple_rel, ripple_hz : float
        Modulation (max - min) / (max + min) of a lamp that is not on direct current, and its frequency.
    ripple : {'pulse', 'sine'}
        Pulses of half of the period between two levels, or a sine.
    locked : bool
        Whether all frames of a session begin at the same phase of the lamp; else each at any.
    drift_rel : float
        Loss of the lamp from the first frame to the end of the calibration.
    lamp_step_rel : float
        Standard deviation of a change of the lamp at once, after all frames and half the readings.
    drift_spread_rel : float
        Standard deviation of that loss over the calibrations, as labcdp takes for granted.
    breathing_rel : float
        Standard deviation of the responsivity after focusing anew between calibration and use.
    stated_change_rel : float
        Standard uncertainty of the responsivity in other sessions that the user of a locked lens states: `refocus_rel`,
        the only one there is for what no frame shows.
    aged_rel : float
        Standard deviation of the responsivity between the sessions, in the second one (`later`).
    warm_up_k, warm_up_rel : float
        How much cooler and more responsive the camera is at the begin of the calibration than in the end.
    scale_half_width_rel : float
        Bound of the meter's scale error, stated and true (rectangular).
    resolution_cd_m2, digits, repeatability_rel : float
        Last digit of the meter, bound of its error in digits, and repeatability.
    noisier : float
        True repeatability over the stated one.
    meter_lag_rel : float
        Share of the reading before in each reading, as of a meter that has not settled.
    readings : int
        Readings of each patch.
    wrong_reading_rel : float
        Error of some readings.
    wrong_readings : int
        How many of all readings have it.
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
    exposure_factors : tuple of (float, float)
        Exposure times and what the camera multiplies them by, of those that are not as stated.
    temperature_c : float
        Of the camera.
    stated_temperature : bool
        Whether frames state the camera's temperature.
    days : float
        After the calibration.
    later : tuple of (str, float or str or bool)
        What is otherwise in the session that is evaluated: names of these parameters and their values, and
        ``warmer_k``, the standard deviation of the camera's temperature from that of the calibration (its dark current
        doubles every 7 K), and ``black_shift_dn``, that of its black level.
    """

    name: str = "ideal"
    causes: tuple[str, ...] = ()
    full_well_e: float = 12_000.0
    k_dn_per_e: float = 0.4
    black_dn: float = 64.0
    read_noise_e: float = 4.0
    dark_current_e_s: float = 5.0
    captures: tuple[Captured, ...] = ()
    coded: bool = False
    prnu_rel: float = 0.0
    dsnu_e: float = 0.0
    column_dn: float = 0.0
    row_dn: float = 0.0
    black_drift_dn: float = 0.0
    cubic: float = 0.0
    gamma: float = 1.0
    knees: tuple[tuple[float, float], ...] = ()
    converters: Literal["", "columns", "halves"] = ""
    converters_rel: float = 0.0
    image_lag_rel: float = 0.0
    longest_first: bool = False
    bayer: bool = False
    coloured: float = 0.0
    vignetting: Literal["cos4", "near cos4", "lens"] = "cos4"
    correction: Literal["none", "cos4", "flat"] = "cos4"
    nonuniformity_rel: float = 0.005
    bracket: bool = False
    glare_rel: float = 0.0
    blur_px: float = 0.0
    halo_rel: float = 0.0
    halo_px: float = 10.0
    light_offset_dn: float = 0.0
    scatter_rel: float = 0.0
    flicker_rel: float = 0.0
    flicker_period_s: float = inf
    ripple_rel: float = 0.0
    ripple_hz: float = 237.0
    ripple: Literal["pulse", "sine"] = "pulse"
    locked: bool = False
    drift_rel: float = 0.0
    lamp_step_rel: float = 0.0
    drift_spread_rel: float = 0.0
    breathing_rel: float = 0.0
    stated_change_rel: float = 0.0
    aged_rel: float = 0.0
    warm_up_k: float = 0.0
    warm_up_rel: float = 0.0
    scale_half_width_rel: float = 0.002
    resolution_cd_m2: float = 1e-5
    digits: int = 1
    repeatability_rel: float = 0.002
    noisier: float = 1.0
    meter_lag_rel: float = 0.0
    readings: int = 3
    wrong_reading_rel: float = 0.0
    wrong_readings: int = 1
    recalibrated: Literal["", "stated", "not stated"] = ""
    patches: int = 10
    exposures_s: tuple[float, ...] = (1e-3, 1e-2, 1e-1)
    darkest_cd_m2: float = 0.5
    gradient_rel: float = 0.0
    hot_spot_rel: float = 0.0
    exposure_offset_s: float = 0.0
    exposure_factors: tuple[tuple[float, float], ...] = ()
    temperature_c: float = 30.0
    stated_temperature: bool = True
    days: float = 0.0
    later: tuple[tuple[str, float | str | bool], ...] = ()
