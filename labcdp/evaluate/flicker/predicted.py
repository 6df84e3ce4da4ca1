"""Flicker that a chain has of the pulsed lamp in its scene, over any parameters, without random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from itertools import product
from math import inf, isfinite, nan, prod
from typing import TYPE_CHECKING, Any

import numpy as np

from ...chain import Chain, LampScene
from ...chain.lamp import flicker_of_light
from ...chain.luminance import is_combined
from ...core.errors import InputError, PredictionError
from ...core.result import Finding, InputFile, Result, info
from ...core.table import Column, Table, attributes_of
from ...report import drawing
from ...report.files import dataset_bytes, result_files
from ...report.layout import SIMULATED, Card, Page, ReportFigure, Section, Verbatim, facts_table
from ...report.text import fixed, span
from ..sweep.maps.axes import UNITS
from ..sweep.plan import Axis, is_scene_parameter

if TYPE_CHECKING:
    from xarray import Dataset

#: Variables of a map of flicker.
VARIABLES = {
    column.name: column
    for column in (
        Column("mmp", "MMP", "", "Modulation mitigation probability over all phases, with the noise of its mean.",
               decimals=4),
        Column("fmi", "FMI", "", "Flicker modulation index over all phases, without noise.", decimals=4),
        Column("fdi", "FDI", "", "Flicker detection index over all phases, with noise.", decimals=4),
        Column("noise_rel", "noise", "%", "Standard deviation of the mean of the lamp from frame to frame.", 2),
        Column("saturated", "saturated", "%", "Share of saturated pixels at the brightest phase.", 2),
    )
}  # fmt: skip
#: Cells of a map at most, and those up to which a table of them is printed.
_MOST_CELLS, _PRINTED_CELLS = 100_000, 30


def predict_flicker(
    chain: Chain,
    axes: Sequence[Axis] = (),
    *,
    stage: str | None = None,
    threshold: float = 0.1,
    tolerance: float = 0.1,
    row_time_s: float = 0.0,
) -> Dataset:
    """Predict the flicker of the pulsed lamp in a chain's scene over parameters.

    Parameters
    ----------
    chain : Chain
        With a scene of type ``lamp``.
    axes : sequence of Axis
        Parameters and their values; none for the chain as it is.
    stage : str or None
        Stage whose noise and saturation count; None for the last.
    threshold, tolerance : float
        As of `labcdp.flicker`.
    row_time_s : float
        Time by which each row of a rolling shutter begins later; the lamp has its `side_px` rows.

    Returns
    -------
    xarray.Dataset
        ``mmp``, ``fmi``, ``fdi``, ``noise_rel`` and ``saturated`` over the axes; the noise is nan where the lamp
        saturates at its mean light, and then counts as 0.

    Raises
    ------
    InputError
        If the scene has no pulsed lamp, or a value is out of its range.
    PredictionError
        If the chain cannot be predicted.

    Examples
    --------
    >>> from labcdp.chain import Chain, LampScene
    >>> from labcdp.evaluate.flicker.predicted import predict_flicker
    >>> from labcdp.evaluate.sweep.plan import Axis
    >>> from dataclasses import replace
    >>> lamp = LampScene(2452, 2056, 20.0, 2.0, side_px=100, frequency_hz=90, duty=0.2)
    >>> chain = replace(Chain.load("manta-g505"), scene=lamp)
    >>> predict_flicker(chain, [Axis("exposure.exposure_s", (0.001, 1 / 90))])["mmp"].values.round(2).tolist()
    [0.01, 1.0]
    """
    import xarray as xr

    if not isinstance(chain.scene, LampScene):
        raise InputError('the scene has no pulsed lamp: give one of type = "lamp"')
    shape = tuple(len(axis.values) for axis in axes)
    if prod(shape) > _MOST_CELLS:
        raise InputError(f"the map would have {prod(shape)} cells: give fewer values, up to {_MOST_CELLS} cells")
    limits = {"threshold": threshold, "tolerance": tolerance, "row_time_s": row_time_s}
    names = [axis.parameter for axis in axes]
    in_scene = [is_scene_parameter(chain, name) for name in names]
    # Cells of one chain that differ in their scene only are predicted together.
    blocks: dict[tuple[Any, ...], list[int]] = {}
    values_of_cells = list(product(*(axis.values for axis in axes)))
    for index, values in enumerate(values_of_cells):
        outside = tuple(value for value, inside in zip(values, in_scene, strict=True) if not inside)
        blocks.setdefault(outside, []).append(index)
    by_index: dict[int, dict[str, float]] = {}
    for indices in blocks.values():
        chains = [chain.with_(**dict(zip(names, values_of_cells[index], strict=True))) for index in indices]
        by_index |= zip(indices, _block(chains, stage, limits), strict=True)
    cells = [by_index[index] for index in range(len(values_of_cells))]
    dims = tuple(axis.parameter for axis in axes)
    data = {}
    for name, column in VARIABLES.items():
        numbers = np.reshape([cell[name] for cell in cells], shape)
        data[name] = (dims, numbers, attributes_of(column, numbers))
    coordinates = {axis.parameter: ((axis.parameter,), np.array(axis.values), _axis_attributes(axis)) for axis in axes}
    attributes = {
        "title": f"{chain.name or 'chain'}: flicker of the lamp",
        "chain_name": chain.name or "chain",
        **limits,
        "stage": stage or chain.stage_names[-1],
        "method": "exact",
        "labcdp_version": version("labcdp"),
        "chain": chain.to_toml(),
    }
    return xr.Dataset(data, coordinates, attributes)


def _axis_attributes(axis: Axis) -> dict[str, str]:
    """Return unit and description of a parameter, as attributes of its coordinate."""
    ending = max((ending for ending in UNITS if axis.parameter.endswith(ending)), key=len, default="")
    unit = "Hz" if axis.parameter.endswith("_hz") else UNITS.get(ending, "1") if axis.numeric else ""
    words = axis.parameter.rpartition(".")[2].removesuffix(ending or "_hz").replace("_", " ")
    return {"unit": unit, "long_name": words}


def _block(chains: Sequence[Chain], stage: str | None, limits: Mapping[str, float]) -> list[dict[str, float]]:
    """Predict cells of chains that differ in their scene only."""
    from ...chain.predict.chain import predict_chain
    from ...chain.predict.lamp import capture_times
    from ...chain.predict.stage import sensor_of_stage

    if not chains[0].sensors:
        raise InputError("the chain has no sensor: add one, with exposure_s")
    sensor, name = sensor_of_stage(chains[0], stage or chains[0].stage_names[-1])
    if is_combined(sensor):
        raise PredictionError("the flicker of the luminance of several planes cannot be predicted: choose a plane")
    times = capture_times(chains[0], sensor, name)
    scenes = [chain.scene for chain in chains if isinstance(chain.scene, LampScene)]
    if len(set(times)) > 1:
        return _merged_block(chains[0], scenes, stage or chains[0].stage_names[-1], limits)
    hows = [{**limits, "n_rows": scene.side_px if limits["row_time_s"] else 1} for scene in scenes]
    lights = [
        scene.lamp.flicker(times[0].exposure_s, **how)  # type: ignore[arg-type]
        for scene, how in zip(scenes, hows, strict=True)
    ]
    brightest = [
        scene.luminance_cd_m2 * light.maximum / light.mean for scene, light in zip(scenes, lights, strict=True)
    ]
    # Steady lamps at the mean light, then at that of the brightest phase.
    n, background = len(scenes), [scene.background_cd_m2 for scene in scenes]
    means = [scene.luminance_cd_m2 for scene in scenes]
    steady: dict[str, list[Any]] = {
        "luminance_cd_m2": [*means, *brightest], "background_cd_m2": background * 2,
        "side_px": [scene.side_px for scene in scenes] * 2, "duty": [1.0] * 2 * n, "phase": [0.0] * 2 * n,
    }  # fmt: skip
    seen = predict_chain(chains[0], steady, stage=stage, contrast=1.0)
    brighter = np.array(steady["luminance_cd_m2"]) >= np.array(background * 2)
    snr = np.where(brighter, seen.snr_bright, seen.snr_dark)[:n]
    full = np.where(brighter, seen.saturated_share, seen.saturated_share_dark)[n:]
    cells = []
    for index, (scene, how) in enumerate(zip(scenes, hows, strict=True)):
        noise_rel = 1 / (float(snr[index]) * scene.side_px) if isfinite(snr[index]) and snr[index] > 0 else nan
        known = noise_rel if isfinite(noise_rel) else 0.0
        flicker = scene.lamp.flicker(times[0].exposure_s, noise_rel=known, **how)  # type: ignore[arg-type]
        values = {name: getattr(flicker, name) for name in ("mmp", "fmi", "fdi")}
        cells.append({**values, "noise_rel": noise_rel, "saturated": float(full[index])})
    return cells


def _merged_block(
    chain: Chain, scenes: Sequence[LampScene], stage: str, limits: Mapping[str, float]
) -> list[dict[str, float]]:
    """Predict cells of captures that are merged, each of which sees the lamp at its own time."""
    from ...chain.predict.lamp import lamp_signals

    if limits["row_time_s"]:
        raise PredictionError(
            "a rolling shutter of several captures cannot be predicted: leave row_time_s out, or predict it with "
            "labcdp.chain.PulsedLamp.flicker"
        )
    cells = []
    for scene, seen in zip(scenes, lamp_signals(chain, scenes, stage), strict=True):
        mean, noise = (
            float(np.trapezoid(values, seen.phases))
            for values in (seen.mean_dn, np.sqrt(seen.variance_dn2) / scene.side_px)
        )
        how = (limits["threshold"], limits["tolerance"])
        off = seen.off_dn if scene.off_level else 0.0
        flicker = flicker_of_light(seen.phases, seen.mean_dn, mean, off, noise, *how)
        values = {name: getattr(flicker, name) for name in ("mmp", "fmi", "fdi")}
        cells.append({**values, "noise_rel": noise / mean, "saturated": float(seen.saturated.max())})
    return cells


def map_result(dataset: Dataset, inputs: Sequence[InputFile] = ()) -> Result:
    """Return the table and findings of a map of flicker."""
    columns = [
        *(
            Column(str(name), str(name), dataset[name].attrs.get("unit", "").replace("1", ""), digits=4)
            for name in dataset.dims
        ),
        *VARIABLES.values(),
    ]
    stacked = dataset.stack(cell=list(dataset.dims)) if dataset.dims else dataset.expand_dims(cell=1)
    data: dict[str, Any] = {column.name: stacked[column.name].values.tolist() for column in columns}
    n_cells = len(data["mmp"])
    note = "Over all phases of the lamp, without random numbers. No compliance with IEEE 2020 is claimed."
    table = Table("flicker", "Flicker of the lamp", tuple(columns), data, note, detail=n_cells > _PRINTED_CELLS)
    findings: list[Finding] = []
    n_full = int((dataset["saturated"].values > 0.01).sum())
    if n_full:
        findings.append(info("flicker-map-saturated", count=n_full, n_cells=n_cells))
    if not np.isfinite(dataset["fdi"].values).any():
        findings.append(info("flicker-map-without-off"))
    attributes = {name: value for name, value in dataset.attrs.items() if name not in ("title", "chain")}
    return Result("sweep", str(dataset.attrs["title"]), (table,), tuple(findings), tuple(inputs), attributes)


def map_files(result: Result, dataset: Dataset) -> dict[str, bytes]:
    """Return the files of a map of flicker by their names: map.nc, results.json, report.html, results.xlsx, figures."""
    figure = map_figure(dataset)
    facts = [(str(name).replace("_", " "), str(value)) for name, value in result.configuration.items()]
    mmp, fmi = dataset["mmp"], dataset["fmi"]
    cards = [
        Card(label, f"{name} {span(fixed(float(values.min()), 3), fixed(float(values.max()), 3))}", "over the map")
        for label, name, values in (
            ("Modulation mitigation probability", "MMP", mmp), ("Flicker modulation index", "FMI", fmi),
        )
    ]  # fmt: skip
    page = Page(
        "Map of flicker",
        result.title,
        summary="FMI, MMP and FDI over all phases of the lamp, predicted without random numbers.",
        banner=SIMULATED,
        cards=cards,
        findings=result.findings,
        sections=[
            *([] if figure is None else [Section("Map", [figure])]),
            Section("Numbers", [*result.tables], collapsed=dataset["mmp"].size > _PRINTED_CELLS),
            Section("Chain and provenance", [facts_table(facts), Verbatim(str(dataset.attrs["chain"]))], True),
        ],
    )
    return {"map.nc": dataset_bytes(dataset, "map of flicker"), **result_files(result, page)}


def map_figure(dataset: Dataset) -> ReportFigure | None:
    """Draw MMP and FMI as curves over one axis of numbers, or as heat maps over the two longest; None without one."""
    axes = sorted(
        (name for name in dataset.dims if dataset[name].dtype.kind in "iuf" and dataset.sizes[name] > 1),
        key=lambda name: -dataset.sizes[name],
    )[:2]
    if not axes:
        return None
    # Of further axes the first value is drawn.
    section = dataset.isel({name: 0 for name in dataset.dims if name not in axes})
    rest = ", ".join(f"{name} = {dataset[name].values[0]}" for name in dataset.dims if name not in axes)
    at = f" At {rest}." if rest else ""
    if len(axes) == 1:
        figure = drawing.new_figure(6.6, 3.6)
        plot = figure.subplots()
        for name, colour in (("mmp", drawing.BLUE), ("fmi", drawing.VERMILLION), ("fdi", drawing.GREEN)):
            if np.isfinite(section[name].values).any():
                plot.plot(section[axes[0]].values, section[name].values, ".-", color=colour, label=name.upper())
        plot.set_ylim(-0.03, 1.03)
        _scale(plot.xaxis, section[axes[0]].values)
        drawing.finish(plot, _label(dataset, axes[0]), "", "")
        return drawing.reported("map", figure, f"MMP, FMI and FDI of the lamp.{at}")
    figure = drawing.new_figure(6.6, 6.4)
    panels = figure.subplots(2, sharex=True)
    x, y = axes[0], axes[1]
    for panel, name in zip(panels, ("mmp", "fmi"), strict=True):
        values = section[name].transpose(y, x).values
        mesh = panel.pcolormesh(
            section[x].values, section[y].values, values, vmin=0, vmax=1, cmap="viridis", shading="nearest"
        )
        _scale(panel.xaxis, section[x].values)
        _scale(panel.yaxis, section[y].values)
        drawing.label(panel, _label(dataset, x) if name == "fmi" else "", _label(dataset, y), name.upper())
        figure.colorbar(mesh, ax=panel).ax.tick_params(labelsize=drawing.SMALL_SIZE)
    return drawing.reported("map", figure, f"MMP and FMI of the lamp.{at}")


def _scale(axis: Any, values: Any) -> None:
    """Make an axis logarithmic if its values are at even steps of the logarithm."""
    if values.min() > 0 and values.size > 2:
        even, even_log = (np.ptp(np.diff(np.sort(x))) / max(np.ptp(x), 1e-300) for x in (values, np.log(values)))
        if even_log < min(even, inf):
            drawing.logarithmic(axis)


def _label(dataset: Dataset, name: Any) -> str:
    unit = str(dataset[name].attrs.get("unit", ""))
    return f"{name}{f' in {unit}' if unit not in ('', '1') else ''}"
