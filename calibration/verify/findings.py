"""Findings of a verification: the verdict, and what the deviations have in common."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from ...core.result import Finding, FindingValue, info, warning
from .result import CLEAR_Z, Verification, VerifiedPatch


def verification_findings(result: Verification) -> tuple[Finding, ...]:
    """Return findings on verdict, common deviation, dark level, colour balance and meters."""
    return (_verdict(result), *_common(result), _dark(result), *_balance(result), _meter(result))


def _verdict(result: Verification) -> Finding:
    bad, open_ = ([row for row in result.patches if row.verdict == verdict] for verdict in ("not conform", "undecided"))
    wide = all(row.guard_rel > row.tolerance_rel for row in open_)
    for holds, rows, code in (
        (bad, bad, "verification-not-conform"),
        (result.dark_not_conform, result.patches, "verification-not-conform-dark"),
        (result.balance_not_conform, result.patches, "verification-not-conform-colours"),
        (open_ and wide, open_, "verification-undecided-uncertainty"),
        (open_, open_, "verification-undecided-limit"),
    ):
        if holds:
            return warning(code, **_values(result, rows))
    if result.unusable:
        return warning("verification-undecided-unusable", patches=list(result.unusable))
    return info("verification-conform", **_values(result, result.patches))


def _values(result: Verification, rows: Sequence[VerifiedPatch]) -> dict[str, FindingValue]:
    """Names of the patches, and the numbers of that with the largest deviation in relation to its limits."""
    worst = max(rows, key=lambda row: abs(row.deviation_rel) + row.guard_rel)
    return {
        "calibrated": f"{result.calibration_measured:%Y-%m-%d}",
        "patches": [row.patch for row in rows],
        "n_patches": len(rows),
        "patch": worst.patch,
        "deviation_rel": worst.deviation_rel,
        "expanded_rel": worst.expanded_rel,
        "guard_rel": worst.guard_rel,
        "tolerance_rel": result.tolerance_rel,
    }


def _common(result: Verification) -> list[Finding]:
    """Distinguish a change common to all patches from that of a single one."""
    mean, expanded = result.mean_rel, result.mean_expanded_rel
    # A single patch hardly moves the median.
    middle = median(row.deviation_rel for row in result.patches)
    worst = max(result.patches, key=lambda row: abs(row.deviation_rel - middle) / row.independent_rel)
    if abs(worst.deviation_rel - middle) > CLEAR_Z * worst.independent_rel:
        return [warning("deviation-single", worst.patch, deviation_rel=worst.deviation_rel - middle)]
    several = len(result.patches) > 1 and abs(mean) > expanded
    return [info("deviation-common", mean_rel=mean, expanded_rel=expanded)] if several else []


def _dark(result: Verification) -> Finding:
    moved = [row for row in result.darks if row.moved]
    if not moved:
        return info("dark-level-kept")
    worst = max(moved, key=lambda row: abs(row.difference_dn) / row.standard_uncertainty_dn)
    return warning(
        "dark-level-moved",
        f"plane {worst.plane}" if len(result.planes) > 1 else "",
        exposure_s=worst.exposure_s,
        difference_dn=worst.difference_dn,
        effect_rel=worst.effect_rel,
    )


def _balance(result: Verification) -> list[Finding]:
    if len(result.planes) == 1:
        return []
    if all(plane.balance_rel is None for plane in result.planes):
        return [warning("colour-balance-unknown")]
    worst = max(result.planes, key=lambda plane: plane.balance_excess_rel)
    if worst.balance_excess_rel == 0:
        return [info("colour-balance-kept")]
    change, expanded = worst.balance_rel, worst.balance_expanded_rel
    return [warning("colour-balance-changed", f"{worst.plane}", change_rel=change, expanded_rel=expanded)]


def _meter(result: Verification) -> Finding:
    now, then = result.meter, result.calibration_meter
    name = f"{now.meter.model} {now.meter.serial}"
    if result.same_meter:
        drift_rel = abs(now.drift_rel - then.drift_rel)
        values = {"drift_rel": drift_rel} if drift_rel else {}
        return info(f"verified-with-same-meter{'-that-drifts' if drift_rel else ''}", name, **values)
    if (now.meter.model, now.meter.serial) == (then.meter.model, then.meter.serial):
        return warning("meter-recalibrated", name, now=now.state, then=then.state)
    return info("verified-with-other-meter", name)
