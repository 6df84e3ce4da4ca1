"""The plan with the regions of the page."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.errors import InputError
from ...regions import Shape
from ...session import SessionConfiguration
from ...session.configuration import Patch, TargetConfiguration


def with_regions(plan: SessionConfiguration, shapes: Sequence[Shape]) -> SessionConfiguration:
    """Return a plan whose patches are these regions, with the nominal luminances and contrasts of the names it has.

    Limits are those of the region, or of the patch where the region has none.

    Raises
    ------
    InputError
        If there is no region.
    """
    if not shapes:
        raise InputError("there are no regions: draw the patches of the target first")
    known = {patch.name: patch for patch in plan.target.patches}
    drawn = []
    for shape in shapes:
        for roi in shape.rois():
            old = known.get(roi.name)
            nominal, limits = (None, None) if old is None else (old.nominal_luminance_cd_m2, old.limits_cd_m2)
            if old is None or old.region() != roi:
                old = Patch(
                    name=roi.name, roi=None, corners=roi.corners, nominal_luminance_cd_m2=nominal, limits_cd_m2=None
                )
            drawn.append(old.model_copy(update={"limits_cd_m2": shape.limits_cd_m2 or limits}))
    patches = tuple(drawn)
    if patches == plan.target.patches:
        return plan
    names = {patch.name for patch in patches}
    target = TargetConfiguration(name=plan.target.name, presentation=plan.target.presentation, patches=patches)
    contrasts = tuple(pair for pair in plan.contrasts if {pair.bright, pair.dark} <= names)
    return plan.model_copy(update={"target": target, "contrasts": contrasts})
