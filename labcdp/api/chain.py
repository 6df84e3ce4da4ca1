"""Imaging chains with sweeps as datasets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from itertools import product
from typing import Any, Self

import numpy as np
from xarray import Dataset

from ..chain import Chain as _Chain
from ..evaluate.camera.sensor import with_emva1288
from ..evaluate.sweep.plan import Axis, Sweep
from ..evaluate.sweep.run import run_sweep
from . import accessor as accessor  # registers it
from .arguments import Contrasts, PathArgument, as_contrasts, as_number, as_path


@dataclass(frozen=True, repr=False)
class Chain(_Chain):
    """An imaging chain: scene, windscreen, optics, sensors, merge and tone curve, frozen dataclasses of parameters.

    ``Chain.load("manta-g505")`` loads a preset (`labcdp.chain.preset_names`) or a chain file, `with_` changes
    parameters, `run` simulates, `sweep` maps CDP over parameters, `save` writes a chain file. See
    `labcdp.chain.parts.ChainParts` for the fields.

    Examples
    --------
    >>> import labcdp
    >>> chain = labcdp.Chain.load("manta-g505").with_(scene__width=64, scene__height=48, scene__square_px=16)
    >>> swept = chain.sweep(exact=True, scene__luminance_cd_m2=[0.01, 100.0])
    >>> swept["cdp"].values.round(2).tolist()
    [0.04, 1.0]
    """

    def sweep(
        self,
        *,
        exact: bool = False,
        stage: str | None = None,
        contrast: Contrasts | None = None,
        epsilon: float | str = 0.5,
        seed: int = 0,
        folder: PathArgument | None = None,
        progress: Callable[[int, int], None] | None = None,
        **axes: Any,
    ) -> Dataset:
        """Map CDP, contrast and signal-to-noise ratios over parameters.

        Parameters
        ----------
        exact : bool
            Predict without random numbers, on the optical axis, behind an EMVA 1288 sensor, instead of simulating.
        stage : str or None
            Stage that is evaluated, for example ``sensor`` or ``hdr``; None for the last.
        contrast : float, str, array_like of them, or None
            Weber contrast to be detected, a fraction or a percentage such as "50%", or several; None for that of the
            scene.
        epsilon : float
            Its relative tolerance.
        seed : int
            Random seed of a simulated sweep.
        folder : path or None
            Folder for a journal, from which an interrupted sweep is resumed; None for none.
        progress : callable or None
            Called with the number of cells that are done, and of all.
        **axes
            Parameters and their values, named as for `with_`: ``scene__luminance_cd_m2=np.geomspace(0.1, 1e4, 200)``.

        Returns
        -------
        xarray.Dataset
            With a dimension for each parameter, ``scene.luminance_cd_m2``, and ``contrast`` for a list of contrasts.
            Its accessor ``labcdp`` finds usable ranges and isolines, and draws the map.

        Raises
        ------
        InputError
            If a parameter is unknown, a value out of range, or the chain cannot be predicted.
        """
        over = tuple(Axis(name if "." in name else name.replace("__", "."), values) for name, values in axes.items())
        target = as_contrasts(contrast, epsilon).targets
        wanted = Sweep(self, over, exact, stage, target, as_number(epsilon, "epsilon"), seed)
        return run_sweep(wanted, None if folder is None else as_path(folder, "folder"), progress)

    def colour_separation(self, *, stage: str | None = None, epsilon: float | str = 0.5, **axes: Any) -> Dataset:
        """Predict how well the colours of the first pair of regions can be told apart behind a colour filter.

        Parameters
        ----------
        stage : str or None
            Stage that is evaluated, for example ``sensor``; None for the last.
        epsilon : float or str
            Relative tolerance of the difference of chromaticity, or a percentage.
        **axes
            Parameters and their values, named as for `sweep`.

        Returns
        -------
        xarray.Dataset
            With a dimension for each parameter: ``colour_distance``, ``csp``, ``csp_counted`` and
            ``colours_detected``, as of `labcdp.colour_separation`, of cells of 2 x 2 pixels.

        Raises
        ------
        InputError
            If the sensor has no colour filter, a parameter is unknown, or a value out of range.
        PredictionError
            If the chain cannot be predicted.

        Examples
        --------
        >>> import labcdp
        >>> green = [[480, 0.0], [530, 0.5], [590, 0.0]]
        >>> efficiencies = {"R": [[570, 0.0], [600, 0.5]], "G": green, "B": [[450, 0.4], [510, 0.0]]}
        >>> chain = labcdp.Chain.load("manta-g505").with_(
        ...     sensor__colour_filter="RGGB",
        ...     sensor__planes=[{"name": name, "quantum_efficiency": curve} for name, curve in efficiencies.items()],
        ...     scene__spectra=[{"region": "bright", "reflectance": [[580, 0.1], [610, 1.0]]}],
        ... )
        >>> separation = chain.colour_separation(scene__luminance_cd_m2=[0.01, 10.0])
        >>> separation["csp"].values.round(2).tolist()
        [0.5, 1.0]
        """
        from ..chain.predict.colour import predict_colours

        over = [Axis(name if "." in name else name.replace("__", "."), values) for name, values in axes.items()]
        tolerance = as_number(epsilon, "epsilon")
        names = {
            "colour_distance": ("distance", "Mahalanobis distance of the colours"),
            "csp": ("csp", "colour separation probability"),
            "csp_counted": ("csp_counted", "share of cells nearer to their own region, covariances of their own"),
            "colours_detected": ("detected", "share of the pairs of cells that keep the difference of chromaticity"),
        }
        shape = tuple(len(axis.values) for axis in over)
        predicted = [
            predict_colours(
                self.with_(**{axis.parameter: value for axis, value in zip(over, values, strict=True)}),
                stage=stage,
                epsilon=tolerance,
            )
            for values in product(*(axis.values for axis in over))
        ]
        dims = tuple(axis.parameter for axis in over)
        data = {
            name: (
                dims,
                np.reshape([getattr(cell, field)[0] for cell in predicted], shape),
                {"long_name": meaning, "units": "1"},
            )
            for name, (field, meaning) in names.items()
        }
        return Dataset(data, {axis.parameter: list(axis.values) for axis in over}, {"epsilon": tolerance})

    def flicker(
        self,
        *,
        stage: str | None = None,
        threshold: float = 0.1,
        tolerance: float = 0.1,
        row_time_s: float = 0.0,
        **axes: Any,
    ) -> Dataset:
        """Predict the flicker of the pulsed lamp in the scene over parameters, without random numbers.

        Parameters
        ----------
        stage : str or None
            Stage whose noise and saturation count, for example ``sensor``; None for the last.
        threshold, tolerance : float
            As of `labcdp.flicker`.
        row_time_s : float
            Time by which each row of a rolling shutter begins later; 0 for a global shutter.
        **axes
            Parameters and their values, named as for `sweep`.

        Returns
        -------
        xarray.Dataset
            ``mmp``, ``fmi``, ``fdi``, the noise of the lamp's mean and the saturated share at its brightest phase, with
            a dimension for each parameter.

        Raises
        ------
        InputError
            If the scene is not of type ``lamp``, a parameter is unknown, or a value out of range.
        PredictionError
            If the chain cannot be predicted.

        Examples
        --------
        >>> from dataclasses import replace
        >>> import labcdp
        >>> scene = labcdp.chain.LampScene(2452, 2056, 20.0, 2.0, side_px=100, frequency_hz=90, duty=0.2)
        >>> chain = replace(labcdp.Chain.load("manta-g505"), scene=scene)
        >>> chain.flicker(exposure__exposure_s=[0.001, 1 / 90])["mmp"].values.round(2).tolist()
        [0.01, 1.0]
        """
        from ..evaluate.flicker.predicted import predict_flicker

        over = [Axis(name if "." in name else name.replace("__", "."), values) for name, values in axes.items()]
        limits = {"threshold": threshold, "tolerance": tolerance, "row_time_s": row_time_s}
        return predict_flicker(self, over, stage=stage, **limits)

    def with_emva1288(self, path: PathArgument) -> Self:
        """Return the chain with the sensor of EMVA 1288 results; its own gives what they do not state.

        Parameters
        ----------
        path : path
            Results of ``labcdp characterise``, or a TOML file with the values of a data sheet in ``[emva1288]``.

        Raises
        ------
        InputError
            If the file cannot be used, or the chain has no single EMVA 1288 sensor.
        """
        return with_emva1288(self, as_path(path, "the EMVA 1288 results"))[0]

    def __repr__(self) -> str:
        height, width = self.scene.shape
        return f"<labcdp.Chain {self.name or self.source!r}: {width} x {height} pixels, {' > '.join(self.stage_names)}>"

    def _repr_html_(self) -> str:
        """Chain file for notebooks."""
        return f"<details><summary>{escape(repr(self))}</summary><pre>{escape(self.to_toml())}</pre></details>"
