"""Command spectra: how well a camera imitates V(lambda), and what another light does to its luminances."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, print_json, print_table, say

if TYPE_CHECKING:
    from ..spectral_table import SpectralTable


def spectra(
    sensitivity: Path | None = typer.Option(
        None,
        help="CSV file of the camera's relative sensitivity to radiant power: columns wavelength_nm and R, G, B, or "
        "one column. Default: list the light sources.",
    ),
    source: str = typer.Option("A", help="Light the camera is calibrated in: a name, or a CSV file with its power."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Tell f1' of a camera, and the factors that correct its luminances in other light.

    Of a camera with colour filters the combination of R, G and B with the smallest f1' is taken.
    """
    from ..photometry import source_names

    if sensitivity is None:
        if as_json:
            print_json({"sources": source_names()})
        else:
            say(f"Light sources by name: {', '.join(source_names())}")
            say("Next: labcdp spectra --sensitivity FILE")
        return
    result = _result(sensitivity, source)
    if as_json:
        print_json(result)
        return
    say(f"f1' = {result['f1_prime']:.2%} (0 for V(lambda); DIN 5032-7 allows 3 % for meters of class A, 6 % for B)")
    if result["weights"]:
        weights = ", ".join(f"{name} {weight:.3g}" for name, weight in result["weights"].items())
        say(f"Weights of the combination: {weights}")
        single = ", ".join(f"{name} {value:.1%}" for name, value in result["f1_prime_of_planes"].items())
        say(f"f1' of the planes alone: {single}")
    rows = [(name, f"{factor:.4f}", f"{1 / factor - 1:+.2%}") for name, factor in result["mismatch_factors"].items()]
    print_table(f"Calibrated in {source} light", ("measured light", "factor F", "error without it"), rows)
    say("Multiply a luminance measured in that light by its F.")


def _result(path: Path, source: str) -> dict[str, Any]:
    from ..spectral_mismatch import COMMON_ILLUMINANTS, f1_prime, least_f1_prime, mismatch_factor, weighted_sum
    from ..spectral_table import read_spectral_file

    file = read_spectral_file(path)
    weights = least_f1_prime(file.columns) if len(file.columns) > 1 else {}
    whole = weighted_sum(file.columns, weights) if weights else file.only
    calibration = _light(source)
    return {
        "sensitivity": str(path),
        "sha256": file.sha256,
        "source": source,
        "f1_prime": f1_prime(whole),
        "f1_prime_of_planes": {name: f1_prime(one) for name, one in file.columns.items()} if weights else {},
        "weights": weights,
        "mismatch_factors": {name: mismatch_factor(whole, name, calibration) for name in COMMON_ILLUMINANTS},
    }


def _light(source: str) -> str | SpectralTable:
    from ..photometry import spectral_weights
    from ..spectral_table import read_spectral_file

    if Path(source).is_file():
        return read_spectral_file(source).only
    try:
        spectral_weights(source)
    except InputError as error:
        raise InputError(f"--source: {error}, or a CSV file") from error
    return source
