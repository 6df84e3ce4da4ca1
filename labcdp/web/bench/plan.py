"""The plan with the regions of the page."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.errors import InputError
from ...core.roi import Roi
from ...session import SessionConfiguration
from ...session.configuration import Patch, TargetConfiguration


def with_regions(plan: SessionConfiguration, regions: Sequence[Roi]) -> SessionConfiguration:
    """Return a plan whose patches are these regions, with the nominal luminances and contrasts of the names it has.

    Raises
    ------
    InputError
        If there is no region.
    """
    if not regions:
        raise InputError("there are no regions: draw the patches of the target first")
    patches = {patch.name: patch for patch in plan.target.patches}
    if list(regions) == [patch.region() for patch in plan.target.patches]:
        return plan
    drawn = tuple(
        Patch(
            name=roi.name,
            roi=None,
            corners=roi.corners,
            nominal_luminance_cd_m2=patches[roi.name].nominal_luminance_cd_m2 if roi.name in patches else None,
        )
        if roi.name not in patches or patches[roi.name].region() != roi
        else patches[roi.name]
        for roi in regions
    )
    names = {patch.name for patch in drawn}
    target = TargetConfiguration(name=plan.target.name, presentation=plan.target.presentation, patches=drawn)
    contrasts = tuple(pair for pair in plan.contrasts if {pair.bright, pair.dark} <= names)
    return plan.model_copy(update={"target": target, "contrasts": contrasts})
