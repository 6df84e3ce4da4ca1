"""What a verification found, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

from .verification import ColourBalance, Verification, VerifiedDark, VerifiedPatch, chance_limits, z_limits


def findings_of(result: Verification) -> tuple[str, ...]:
    """Tell the verdict, the drift, the colours, the darkness, and which meter's scale counts."""
    return (_verdict(result), _drift(result), *_colours(result), *_dark(result), _meter(result))


def _verdict(result: Verification) -> str:
    since = f"{result.calibration_measured:%Y-%m-%d}"
    worst = max(result.patches, key=lambda row: abs(row.z))
    n = len(result.patches)
    patches = "1 patch" if n == 1 else f"{n} patches"
    if result.verdict == "valid":
        return (
            f"the calibration of {since} is still valid: camera and meter agree on {patches} within their uncertainty "
            f"(largest difference {_patch(worst)})"
        )
    changed = _changed(result)
    if result.verdict == "doubtful" and changed is not None:
        return (
            f"the calibration of {since} is doubtful: the colour balance has changed, so luminances of coloured "
            "patches may be wrong: verify again, or calibrate again"
        )
    if result.verdict == "doubtful":
        return (
            f"the calibration of {since} is doubtful: a difference like {_patch(worst)} is rarely chance; verify again "
            "with more patches, or calibrate again"
        )
    if _moved(result) and _explained(result):
        return (
            f"the calibration of {since} is no longer valid, because the dark level has moved; with the new dark "
            "frames camera and meter agree: calibrate again at the camera's present temperature and settings"
        )
    if changed is not None and changed.effect_rel > abs(result.drift_rel):
        return (
            f"the calibration of {since} is no longer valid, because the colour balance has changed, and with it the "
            "luminance of coloured patches: calibrate again"
        )
    if abs(result.drift_rel) > result.drift_half_width_95_rel:
        return (
            f"the calibration of {since} is no longer valid: the camera has drifted by {_percent(result.drift_rel)} "
            f"± {_percent(result.drift_half_width_95_rel, sign=False)}: calibrate again"
        )
    return (
        f"the calibration of {since} is no longer valid: the patches disagree with it and with each other, most of "
        f"all {_patch(worst)}; check regions, light and lens, and calibrate again"
    )


def _drift(result: Verification) -> str:
    return (
        f"drift since the calibration: {_percent(result.drift_rel)} ± "
        f"{_percent(result.drift_half_width_95_rel, sign=False)} (95 %)"
    )


def _colours(result: Verification) -> list[str]:
    if len(result.planes) == 1:
        return []
    balance = result.balance
    if balance is None:
        return [
            "whether the colours have changed alike is not known: verify with a grey patch that the calibration was "
            "made with"
        ]
    if balance.chance >= chance_limits()[0]:
        return ["the colour balance is where it was"]
    chance = "" if _changed(result) else " (which may still be chance)"
    return [f"the colour balance has changed: {_balance(balance)}{chance}: the light, a filter or the sensor changed"]


def _changed(result: Verification) -> ColourBalance | None:
    """Colours that have changed differently by more than chance."""
    balance = result.balance
    return None if balance is None or balance.chance >= chance_limits()[1] else balance


def _balance(balance: ColourBalance) -> str:
    verb = "lost" if balance.change_rel < 0 else "gained"
    return (
        f"{balance.odd} has {verb} {_percent(abs(balance.change_rel), sign=False)} ± "
        f"{_percent(balance.half_width_95_rel, sign=False)} against {balance.against}"
    )


def _dark(result: Verification) -> list[str]:
    moved = _moved(result)
    if not moved:
        return ["the dark level is where it was"]
    worst = max(moved, key=lambda row: abs(row.z))
    plane = f" in plane {worst.plane}" if len(result.planes) > 1 else ""
    return [
        f"the dark level has moved by {worst.difference_dn:+.2g} DN at {worst.exposure_s:g} s{plane}, which makes "
        f"{_percent(worst.effect_rel)} at the lowest calibrated luminance: compare the camera's temperature and black "
        "level with those of the calibration"
    ]


def _meter(result: Verification) -> str:
    meter = f"{result.meter.model} {result.meter.serial}"
    if result.same_meter:
        return f"the meter {meter} is the calibration's, so its scale error cancels"
    return f"the meter {meter} is not the calibration's, or was adjusted since, so the scale errors of both count"


def _moved(result: Verification) -> Sequence[VerifiedDark]:
    limit = z_limits(len(result.darks))[1]
    return [row for row in result.darks if abs(row.z) > limit]


def _explained(result: Verification) -> bool:
    """Whether the new dark frames alone bring camera and meter together."""
    limit = z_limits(len(result.patches))[0]
    return all(
        row.with_new_dark_rel is not None and abs(row.with_new_dark_rel) <= limit * row.standard_uncertainty_rel
        for row in result.patches
    )


def _patch(row: VerifiedPatch) -> str:
    return f"{_percent(row.difference_rel)} at patch {row.patch!r}, z = {row.z:+.1f}"


def _percent(fraction: float, sign: bool = True) -> str:
    return f"{100 * fraction:{'+' if sign else ''}.2g} %"
