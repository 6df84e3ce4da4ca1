"""Values of sessions, pictures, characterisations and calibrations that can be compared one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import nan, sqrt
from typing import Any

from ...calibration.verify.history import histories
from ...core.disk import number_of
from ...core.errors import InputError
from ..bench.quantities import RESPONSIVITY
from .grid import Source, Uncertain
from .subject import Subject, damaged


@dataclass(frozen=True, eq=False)
class Named(Uncertain):
    """A value that is compared with the one of the same quantity of another subject.

    Parameters
    ----------
    value, below, above, common, sources
        As of `Uncertain`.
    quantity, unit : str
        Name of the quantity, and its unit; values in ``%`` are fractions.
    probability : bool
        Whether it is a CDP.
    """

    quantity: str = ""
    unit: str = ""
    probability: bool = False


def values_of(subject: Subject) -> dict[str, Named]:
    """Return the values of a subject by their quantity.

    Raises
    ------
    InputError
        If the results are damaged.
    """
    of = {"session": _session, "picture": _picture, "characterisation": _characterisation, "calibration": _calibration}
    try:
        return {row.quantity: row for row in of[subject.kind](subject)}
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(damaged(subject.name)) from error


def _session(subject: Subject) -> Iterator[Named]:
    tables = subject.content["tables"]
    provenance = {row["item"]: row["value"] for row in tables["provenance"]["rows"]}
    frames = "frames", provenance["SHA-256 of frames and readings"]
    calibration = "calibration", provenance["SHA-256 of those of the calibration"]
    yield from _ranges_and_colours(tables, None, frames)
    for row in tables["contrasts"]["rows"]:
        text = f"CDP of {row['pair']} at {_percent(row['target_contrast'])}, ε {_percent(row['epsilon'])}"
        yield _cdp(text, row, frames, calibration)
    for row in {row["pair"]: row for row in tables["contrasts"]["rows"]}.values():
        contrast = row["camera_contrast"], row["expanded_camera_contrast"]
        yield _symmetric(f"contrast of {row['pair']}", "%", *contrast, {}, (frames, calibration))


def _picture(subject: Subject) -> Iterator[Named]:
    tables, number = subject.content["tables"], subject.content["number"]
    (sha256,) = (row["sha256"] for row in tables["pictures"]["rows"] if row["number"] == number)
    calibrations = [file["sha256"] for file in subject.content["inputs"] if file["role"] == "calibration"]
    # Without a calibration, it is the vignetting of the lens that contrasts at the same places have in common.
    (camera,) = (row["camera"] for row in tables["pictures"]["rows"] if row["number"] == number)
    calibration = ("calibration", calibrations[0]) if calibrations else ("vignetting", camera or "of the lens")
    picture = "picture", sha256
    (file,) = (row["picture"] for row in tables["pictures"]["rows"] if row["number"] == number)
    yield from _ranges_and_colours(tables, file, picture)
    rows = [row for row in tables["cdp"]["rows"] if row["number"] == number]
    for row in rows:
        measured = row["contrast_origin"] == "measured"
        target_text = "its contrast" if measured else _percent(row["contrast"])
        below, above = row["tolerance_below"], row["tolerance_above"]
        ends = [_percent(below) if below == above else f"{_percent(below)}, {_percent(above)}"]
        yield _cdp(f"CDP of {row['pair']} at {target_text}, ε {ends[0]}", row, picture, calibration)
    for row in {row["pair"]: row for row in rows}.values():
        u, by_pixels = (_number(row[name]) for name in ("u_measured_contrast", "u_measured_contrast_pixels"))
        parts = _uncertainty_parts(u, by_pixels, picture, calibration)
        # Of saturated regions it is a bound, which nothing is compared with.
        is_bound = bool(row.get("measured_contrast_bound"))
        value, expanded = (
            None if is_bound else row[name] for name in ("measured_contrast", "expanded_measured_contrast")
        )
        yield _symmetric(f"contrast of {row['pair']}", "%", value, expanded, parts)


def _ranges_and_colours(tables: Mapping[str, Any], file: str | None, pixels: Source) -> Iterator[Named]:
    """Yield dynamic ranges of a chart, and what is said of colours, where there are; of a picture among several."""

    def rows(table: str) -> Iterator[Mapping[str, Any]]:
        yield from (row for row in tables.get(table, {"rows": ()})["rows"] if file is None or row["picture"] == file)

    for row in rows("dynamic_range"):
        # A range that ends with the chart is a bound, which nothing is compared with.
        known = not row["range_stops_bound"]
        value, expanded = (row[name] if known else None for name in ("range_stops", "expanded_range_stops"))
        text = f"dynamic range, {row['figure']} ≥ {row['limit']:g}"
        yield _symmetric(text, "stops", value, expanded, {pixels: 1.0})
    for row in rows("colour_separation"):
        for name, label in (("distance", "colour distance"), ("csp", "CSP"), ("detected", "pairs detected")):
            value, low, high = (_number(row[key]) for key in (name, f"{name}_low", f"{name}_high"))
            text = f"{label} of {row['pair']}"
            yield Named(value, value - low, high - value, {pixels: 1.0}, (), text, "", name != "distance")


def _characterisation(subject: Subject) -> Iterator[Named]:
    data = {(file["role"], file["sha256"]): 1.0 for file in subject.content["inputs"][:1]}
    for row in subject.content["tables"]["characterisation"]["rows"]:
        unit = "%" if row["unit"] == "1" else str(row["unit"] or "")
        yield _symmetric(str(row["quantity"]), unit, row["value"], row["expanded_value"], data)


def _calibration(subject: Subject) -> Iterator[Named]:
    data = "data", subject.content.provenance.input_sha256
    for history in histories({subject.name: subject.content}, {}):
        (point,) = history.points
        plane = f" of plane {history.plane}" if history.plane else ""
        assert point.responsivity is not None
        r, own_source, whole = point.responsivity
        parts = _uncertainty_parts(whole, own_source, data, ("meter", f"{point.meter}")) if whole else {}
        yield _symmetric(f"responsivity R{plane}", RESPONSIVITY, r, r * whole, parts)
        yield _symmetric(f"dark offset{plane}", "DN", *point.dark_offset_dn, {data: 1.0})
        if point.dark_rate_dn_s is not None:
            yield _symmetric(f"dark rate{plane}", "DN/s", *point.dark_rate_dn_s, {data: 1.0})
        if point.k_dn_per_e is not None:
            yield _symmetric(f"overall system gain K{plane}", "DN/e⁻", point.k_dn_per_e, None, {})


def _symmetric(
    quantity: str, unit: str, value: Any, expanded: Any, common: dict[Source, float], sources: tuple[Source, ...] = ()
) -> Named:
    u = _number(expanded)
    return Named(_number(value), u, u, common, sources, quantity, unit)


def _cdp(quantity: str, row: Mapping[str, Any], pixels: Source, calibration: Source) -> Named:
    """Return a CDP, whose uncertainty is by its pixels and by the calibration."""
    value, low, high = (_number(row[name]) for name in ("cdp", "cdp_low", "cdp_high"))
    parts = _uncertainty_parts(_number(row["u_cdp"]), _number(row["u_cdp_pixels"]), pixels, calibration)
    return Named(value, value - low, high - value, parts, (), quantity, "", True)


def _uncertainty_parts(u: float, u_own: float, own_source: Source, other: Source) -> dict[Source, float]:
    """Return the parts of an uncertainty by an error of its own and by another one, over the whole."""
    # Of a CDP of 0 or 1 both are 0, and the interval is by the number of pixels.
    part = min(u_own / u, 1.0) if u > 0 else 1.0
    return {own_source: part, other: sqrt(1 - part**2)}


def _number(value: Any) -> float:
    return nan if value is None else number_of(value)


def _percent(fraction: Any) -> str:
    return "∞" if fraction is None else f"{100 * number_of(fraction):.6g} %"
