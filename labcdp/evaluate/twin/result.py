"""The comparison of a camera and its twin as labelled tables, and its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from math import ceil, comb, floor
from typing import Any

import numpy as np

from ...calibration.uncertainty import critical_value
from ...core.result import Finding, InputFile, Result, info, quantity_table, warning
from ...core.table import Column, Table, uncertain, with_interval
from ...report.drawing import BLUE, VERMILLION, finish, new_figure, reported
from ...report.files import result_files
from ...report.layout import Card, Page, ReportFigure, Section, State, Verbatim, page_text
from ...report.text import Z_95, finding_text, percent
from ..bench.session_result import provenance_table
from ..camera.result import stated
from ..camera.sensor import commented_toml
from .evaluate import TwinEvaluation
from .pair import TwinPair
from .regions import KINDS


def twin_result(
    evaluation: TwinEvaluation, inputs: Sequence[InputFile] = (), options: dict[str, Any] | None = None
) -> Result:
    """Return all numbers of the comparison of a camera and its twin.

    Parameters
    ----------
    evaluation : TwinEvaluation
        The evaluation to report.
    inputs : sequence of InputFile
        Inputs of the comparison.
    options : dict
        Options of the comparison.
    """
    name = evaluation.observed.configuration.name
    findings = [verdict(evaluation), *signal_findings(evaluation), *evaluation.findings]
    more = {"configuration": options or {}, "simulated": evaluation.calibration.state.camera.simulated}
    return Result.of("twin", name, _tables(evaluation), findings, *inputs, **more)


def _tables(evaluation: TwinEvaluation) -> Iterator[Table]:
    yield _pairs(evaluation.pairs)
    yield _signals(evaluation)
    rows = (stated(key, *named) for key, named in evaluation.parameters.quantities.items())
    yield quantity_table("parameters", "Parameters of the twin", rows, detail=True)
    yield provenance_table(evaluation.observed, evaluation.calibration)


def _pairs(pairs: Sequence[TwinPair]) -> Table:
    difference = Column("difference", "difference", "", "Measured minus predicted; U and u are those of both.")
    columns = (
        Column("pair", "bright / dark", value="name"),
        Column("target_contrast", "target contrast", "%", "Weber contrast to be detected.", 0, value="contrast"),
        Column("bright", "bright patch", shown=False),
        Column("dark", "dark patch", shown=False),
        Column("epsilon", "tolerance ε", "%", "Contrasts within the target contrast ± ε of it count.", 0),
        Column("meter_contrast", "contrast by meter", "%", "Of the mean luminances from the meter.", shown=False),
        *with_interval(Column("measured_cdp", "measured CDP", value="measured.cdp",
                              meaning="From the camera; its interval comes from the number of pixels."),
                       "measured.interval"),
        *with_interval(Column("predicted_cdp", "predicted CDP", value="predicted",
                              meaning="From the twin, for an infinitely large region."), "predicted_interval"),
        *uncertain(difference, "u_difference"),
        Column("z", "z", "", "The difference divided by its standard uncertainty.", decimals=1),
        Column("judgement", "comparison", "", "Whether 0 is in the 95 % interval of the difference."),
        Column("exposure_s", "exposure", "s", "Longest that saturates neither patch.", digits=0, time=True),
        Column("frame_number", "frame", "", "Number of the frame with the bright patch.", shown=False),
        Column("dark_frame_number", "frame (dark)", "", "Number of the frame with the dark patch.", shown=False),
    )  # fmt: skip
    return Table.of_items("pairs", "Contrast detection probability of pairs of patches", columns, pairs)


def _signals(evaluation: TwinEvaluation) -> Table:
    columns = [
        Column("patch", "patch", value="name"),
        Column("luminance_cd_m2", "luminance by meter", "cd/m²", "Mean reading."),
        Column("exposure_s", "exposure", "s", "Longest that does not saturate the patch.", digits=0, time=True),
    ]
    for kind, label in KINDS.items():
        columns += _columns_for_kind(kind, label)
    table = Table.of_items(
        "signals", "Signal of each patch", columns, evaluation.patches, "± is U (95 %).", detail=True
    )
    return table.sorted_by("luminance_cd_m2")


def _columns_for_kind(kind: str, label: str) -> tuple[Column, ...]:
    meaning = "Measured minus predicted (for noise, of the variances), divided by its standard uncertainty."
    measured, predicted = (Column(f"{of}_{kind}", f"{label}, {of}", "DN") for of in ("measured", "predicted"))
    return (
        *uncertain(
            replace(measured, value=lambda patch: patch.measured[kind][0]), lambda patch: patch.measured[kind][1]
        ),
        *uncertain(
            replace(predicted, value=lambda patch: patch.predicted[kind][0]), lambda patch: patch.predicted[kind][1]
        ),
        Column(f"z_{kind}", f"{label}, z", "", meaning, decimals=1, value=lambda patch: patch.z[kind]),
    )


#: Significance level of the number of differing pairs, and expected share of pairs that differ by chance.
_CHANCE, _EXPECTED = 0.01, 0.05


def verdict(evaluation: TwinEvaluation) -> Finding:
    """Return whether the twin describes the camera, by the CDPs and by the signals of the patches."""
    differing = evaluation.count("differ")
    n = differing + evaluation.count("agree")
    counts: dict[str, float] = {"decided": n, "differing": differing, "by_chance": _EXPECTED * n}
    # The CDPs of a pair at several contrasts are of the same pixels: each contrast is judged on its own.
    groups = evaluation.by_contrast()
    if any(_chance(pairs) < _CHANCE / len(groups) for pairs in groups):
        return warning("twin-differs", **counts)
    if any(signal_findings(evaluation)):
        return warning("twin-signals-differ", **counts)
    return info("twin-describes-camera", **counts) if n else warning("twin-undecided", **counts)


def _chance(pairs: Sequence[TwinPair]) -> float:
    """Probability that by chance at least as many pairs differ."""
    differing = sum(pair.judgement == "differ" for pair in pairs)
    n = sum(pair.judgement != "undecided" for pair in pairs)
    return sum(comb(n, k) * _EXPECTED**k * (1 - _EXPECTED) ** (n - k) for k in range(differing, n + 1))


def signal_findings(evaluation: TwinEvaluation) -> Iterator[Finding]:
    """Yield a warning for each kind of signal in which a patch deviates by more than by chance in 1 % of sessions."""
    limit = critical_value(len(KINDS) * len(evaluation.patches))
    for kind, name in KINDS.items():
        z = {patch.name: z for patch in evaluation.patches if (z := patch.z[kind]) is not None and abs(z) > limit}
        if z:
            worst = max(z, key=lambda patch: abs(z[patch]))
            yield warning("signal-differs", name, patches=list(z), worst=worst, z=z[worst])


#: Significant digits of the values in the file.
_DIGITS = 7


def twin_chain_text(evaluation: TwinEvaluation) -> str:
    """Write the twin as TOML: the camera of a session before the session's patches, at an exposure of the session.

    Patches keep their names, and the pairs of the plan are evaluated. Those shown together keep their positions; the
    surroundings, which were not measured, get the luminance of the darkest patch. Patches shown one by one become
    stripes. The values carry their standard uncertainties as comments.
    """
    notes = [f"Note: {finding_text(finding)}" for finding in evaluation.parameters.findings]
    comments = {}
    for name, (_, quantity) in evaluation.parameters.quantities.items():
        key = "quantum_efficiency" if name.startswith("quantum") else name
        uncertainty = f"u = {quantity.u_known:.2g} {quantity.unit}; " if quantity.u_known > 0 else ""
        comments["sensor", key] = f"{uncertainty}{quantity.note}".rstrip("; ")
    head = ["Twin of a camera, made by labcdp from a recorded session.", "u is the standard uncertainty.", *notes]
    return commented_toml(head, twin_document(evaluation), comments)


def twin_document(evaluation: TwinEvaluation) -> dict[str, Any]:
    """Tables of the chain file."""
    twin, configuration = evaluation.parameters, evaluation.observed.configuration
    shape = evaluation.calibration.state.image_shape
    sensor = asdict(twin.sensor(shape))
    del sensor["device_seed"]
    # The chain file states K at 0 dB; the sensor here has K at the session's gain.
    sensor["k_dn_per_e"] /= 10 ** (twin.gain_db / 20)
    lens, observed = configuration.lens, evaluation.observed
    exposure_s = observed.longest_unsaturated_s(evaluation.calibration, *observed.names)
    if exposure_s is None:
        exposure_s = min(o.exposure_s for group in observed.patches.values() for o in group)
    optics = {"f_number": lens.f_number, "transmittance": twin.transmittance, "focal_length_m": lens.focal_length_m}
    return {
        "name": "twin",
        "description": f"Twin of {evaluation.calibration.state.camera}, from the session {configuration.name}",
        "spectrum": configuration.source.spectrum,
        "scene": _scene(evaluation, shape),
        "optics": optics,
        "exposure": {"exposure_s": exposure_s, "gain_db": twin.gain_db, "temperature_c": twin.temperature_c},
        "sensor": {"type": "emva1288", **{name: _rounded(value) for name, value in sensor.items()}},
    }


def _rounded(value: Any) -> Any:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def _scene(evaluation: TwinEvaluation, shape: tuple[int, int]) -> dict[str, Any]:
    height, width = shape
    regions = sorted(evaluation.regions, key=lambda region: region.luminance_cd_m2)
    names = {region.name: f"patch {region.name}" if region.name == "background" else region.name for region in regions}
    levels = [_rounded(region.luminance_cd_m2) for region in regions]
    configuration = evaluation.observed.configuration
    # Each pair once, though a plan may ask for it at several contrasts.
    pairs = dict.fromkeys((pair.bright, pair.dark) for pair in configuration.contrasts)
    kept = [[names[bright], names[dark]] for bright, dark in pairs if bright in names and dark in names]
    contrasts = {"contrasts": kept} if kept else {}
    if configuration.target.presentation == "one by one":
        return {"type": "step-chart", "luminances_cd_m2": levels, "names": [*names.values()], **contrasts}
    bounds = {patch.name: patch.region().bounds for patch in configuration.target.patches}
    patches = []
    for region in evaluation.regions:
        left, top, right, bottom = bounds[region.name]
        x, y = max(floor(left), 0), max(floor(top), 0)
        size = {"width": min(ceil(right), width) - x, "height": min(ceil(bottom), height) - y}
        fields = {"luminance_cd_m2": _rounded(region.luminance_cd_m2), "name": names[region.name]}
        patches.append({"x": x, "y": y, **size, **fields})
    return {"type": "patches", "background_cd_m2": levels[0], **contrasts, "patches": patches}


def twin_figure(evaluation: TwinEvaluation) -> ReportFigure:
    """Draw all pairs: measured over predicted CDP with 95 % bars, and the standardised differences."""
    figure = new_figure(11.0, 5.2, "bench" if evaluation.calibration.state.camera.simulated else "")
    left, right = figure.subplots(1, 2)
    for name, colour, marker in (("agree", BLUE, "o"), ("differ", VERMILLION, "s"), ("undecided", "0.5", "^")):
        pairs = [pair for pair in evaluation.pairs if pair.judgement == name]
        if not pairs:
            continue
        style = {"fmt": marker, "markersize": 5, "color": colour, "markerfacecolor": "none"}
        measured = np.array([[pair.measured.cdp, *pair.measured.interval] for pair in pairs]).T
        predicted = np.array([[pair.predicted, *pair.predicted_interval] for pair in pairs]).T
        x, y = (np.maximum([values[0] - values[1], values[2] - values[0]], 0) for values in (predicted, measured))
        left.errorbar(predicted[0], measured[0], y, x, elinewidth=0.8, label=name, **style)
        right.errorbar(predicted[0], [pair.z for pair in pairs], **style)
    left.plot([0, 1], [0, 1], color="0.5", linewidth=1, zorder=0)
    left.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), aspect="equal")
    finish(left, "CDP predicted by the twin", "CDP measured", "Pairs of patches, with 95 % bars")
    right.axhspan(-Z_95, Z_95, color="0.93", zorder=0)
    right.axhline(0, color="0.5", linewidth=1, zorder=0)
    largest = 1.1 * max(3.0, *(abs(pair.z) for pair in evaluation.pairs))
    right.set(xlim=(-0.03, 1.03), ylim=(-largest, largest))
    finish(right, "CDP predicted by the twin", "(measured - predicted) / its standard uncertainty", "Grey: 95 %")
    n, agreeing, differing = len(evaluation.pairs), evaluation.count("agree"), evaluation.count("differ")
    picture = page_text("twin-picture", n_pairs=n, agreeing=agreeing, differing=differing)
    return reported("twin", figure, page_text("twin"), picture)


#: Value and colour of the first card, by the code of the verdict.
_VERDICTS: dict[str, tuple[str, State]] = {
    "twin-describes-camera": ("agree", "good"),
    "twin-differs": ("differ", "bad"),
    "twin-signals-differ": ("differ", "bad"),
    "twin-undecided": ("undecided", "open"),
}
#: Columns of pairs that fit on a page.
_PAIR = (
    "pair", "target_contrast", "measured_cdp", "measured_cdp_low", "measured_cdp_high", "predicted_cdp",
    "predicted_cdp_low", "predicted_cdp_high", "difference", "expanded_difference", "z", "judgement",
)  # fmt: skip


def twin_files(evaluation: TwinEvaluation, result: Result) -> dict[str, bytes]:
    """Return the files of a twin and its comparison with the camera as `result_files` does, and chain.toml."""
    chain, configuration = twin_chain_text(evaluation), evaluation.observed.configuration
    camera, n = evaluation.calibration.state.camera, len(evaluation.regions)
    summary = f"{camera.model}, {n} patches of {configuration.target.name}, {configuration.operator}."
    lead, sections = [twin_figure(evaluation)], _sections(result, chain)
    page = Page.of(result, "A camera and its simulated twin", summary, _cards(evaluation), lead, sections)
    return {"chain.toml": chain.encode(), **result_files(result, page)}


def _cards(evaluation: TwinEvaluation) -> Iterator[Card]:
    value, state = _VERDICTS[verdict(evaluation).code]
    differing = [f"{finding.subject}" for finding in signal_findings(evaluation)]
    signals = f"signals of the patches differ: {', '.join(differing)}" if differing else "signals of the patches agree"
    yield Card("Camera and twin", value, signals, state=state)
    lines = (f"{evaluation.count('differ')} differ, {evaluation.count('undecided')} undecided",)
    of = f"{evaluation.count('agree')} of {len(evaluation.pairs)}"
    yield Card("Pairs that agree", of, "within the joint 95 % interval", lines, state=state)
    worst = max(evaluation.pairs, key=lambda pair: abs(pair.z))
    detail, at = f"measured minus predicted CDP of {worst.name}", percent(worst.contrast)
    yield Card("Largest deviation", f"z = {worst.z:.1f}", detail, (f"target contrast {at}",))


def _sections(result: Result, chain: str) -> Iterator[Section]:
    yield Section("Pairs", (result.table("pairs").only(*_PAIR),))
    yield Section("Signals of the patches", (page_text("twin-signals"), result.table("signals")))
    yield Section("Parameters of the twin", (result.table("parameters"), Verbatim(chain)), collapsed=True)
    method = page_text("twin-method"), result.table("provenance")
    yield Section("Method and provenance", method, collapsed=True)
