"""The constants of tracking: what each means, which range is accepted, and where its value comes from."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from ..core.errors import InputError

#: Origins of the constants.
_SIMULATED = "simulated disturbances (benchmarks/tracking_accuracy.py)"
_CODED = "coded simulated videos (benchmarks/tracking_coded.py)"
_REAL = "real videos, development half (benchmarks/tracking_real.py)"
_COST = "cost: larger is slower, and no better"


def _constant(value: float, least: float, most: float, meaning: str, origin: str) -> Any:
    return field(default=value, metadata={"least": least, "most": most, "meaning": meaning, "origin": origin})


@dataclass(frozen=True)
class TrackingSettings:
    """Constants of tracking.

    Each field has the accepted range (`least`, `most`), its `meaning` and `origin` as metadata; the reference has
    them as a table. Lengths are in pixels of the frame (px), of the template (template_px), or in parts of a size; DN
    are those of 8 bits; shares are 0 to 1.

    Raises
    ------
    InputError
        If a value lies outside its range.

    Examples
    --------
    >>> from labcdp.tracking.settings import TrackingSettings
    >>> TrackingSettings().covered_share
    0.05
    """

    # fmt: off
    # The frame
    small_frame_px: int = _constant(480, 240, 960, "longest side of the small frame in which the scene is watched",
        _COST)
    rounding_noise_dn: float = _constant(0.3, 0.2, 0.5, "least noise: that of rounding to whole DN, 1/sqrt(12)",
        "closed form")
    scaled_noise_dn: float = _constant(3.2, 1.0, 6.0, "noise that frames of more than 8 bits are scaled to", _SIMULATED)
    scaled_structure_dn: float = _constant(16.0, 8.0, 32.0, "standard deviation that dark frames are brightened to, "
        "as far as their noise allows", _CODED)
    structure_over_noise: float = _constant(3.0, 2.0, 5.0, "standard deviation of a frame over its noise from which "
        "it shows more than noise", _SIMULATED)
    noise_sample_px: int = _constant(512, 128, 1024, "side of the part of a frame that its noise is estimated from",
        _COST)
    # The template
    template_side_px: int = _constant(48, 32, 96, "longest side of a template in its own pixels", _COST)
    noisy_dn: float = _constant(6.0, 4.0, 10.0, "noise from which a template is reduced further", _SIMULATED)
    noisy_side_px: int = _constant(20, 16, 32, "longest side down to which it is reduced then", _SIMULATED)
    margin_share: float = _constant(0.08, 0.04, 0.2, "margin around a region at which its window begins to grow, in "
        "parts of its longer side", _SIMULATED)
    margin_px: float = _constant(3.0, 2.0, 8.0, "least such margin", _SIMULATED)
    margin_growth: float = _constant(1.25, 1.1, 1.5, "factor of a step of growth", _COST)
    margin_most_px: float = _constant(48.0, 24.0, 96.0, "margin up to which a window may grow at least", _SIMULATED)
    margin_beyond_share: float = _constant(0.15, 0.0, 0.3, "what a window takes in beyond what fixes its position, "
        "in parts of the margin: half of an edge seems smaller", _SIMULATED)
    margin_beyond_px: float = _constant(2.0, 1.0, 4.0, "and at least", _SIMULATED)
    margin_beyond_template_px: float = _constant(1.6, 1.0, 3.0, "and at least, in template pixels", _SIMULATED)
    position_px: float = _constant(0.25, 0.1, 0.5, "standard deviation with which a window should fix its position "
        "along its weakest direction", _SIMULATED)
    position_most_px: float = _constant(0.5, 0.3, 1.0, "and must, or the region is refused", _SIMULATED)
    window_worth: float = _constant(2.0, 1.5, 4.0, "factor by which a larger window must fix the position better to "
        "be worth what it takes in", _SIMULATED)
    unlike_dn: float = _constant(1.0, 0.5, 2.0, "what light, blur and interpolation leave even without noise",
        _SIMULATED)
    coding_noise_dn: float = _constant(1.2, 0.8, 2.0, "least noise of a template: what the coding of a video leaves "
        "of a smoothed image", _CODED)
    kept_noise_dn: float = _constant(0.6, 0.4, 1.0, "noise inside a region that tells that a codec left out nothing",
        _CODED)
    edge_template_px: int = _constant(5, 3, 9, "width of the edge of a patch that moves with it, on both sides "
        "together", _SIMULATED)
    weight_beyond: float = _constant(0.25, 0.1, 0.5, "weight of pixels beyond the edge of the patch, before "
        "anything has moved", _SIMULATED)
    background_rim_share: float = _constant(0.3, 0.2, 0.6, "share of the rim of the window that belongs to the "
        "patch of a region of the background", _SIMULATED)
    plain_noise: float = _constant(3.0, 2.0, 5.0, "standard deviation of a plain region over its noise, at most",
        _SIMULATED)
    plain_share: float = _constant(0.06, 0.03, 0.1, "and in parts of its brightness", _SIMULATED)
    # Alignment
    coarse_steps: int = _constant(8, 4, 16, "most Gauss-Newton steps at half the size", _COST)
    fine_steps: int = _constant(5, 3, 10, "and at full size", _COST)
    still_template_px: float = _constant(0.02, 0.005, 0.05, "step after which no other one is made", _COST)
    robust_sigma: float = _constant(2.5, 2.0, 4.0, "residuals from which on pixels count little, in standard "
        "deviations", _SIMULATED)
    allowed_share: float = _constant(0.06, 0.03, 0.1, "residual that is always allowed, in parts of the structure: "
        "interpolation, blur", _SIMULATED)
    light_changed_share: float = _constant(0.75, 0.5, 0.9, "factor by which residuals must be smaller for a light "
        "that was not expected", _SIMULATED)
    gain_least: float = _constant(0.05, 0.02, 0.1, "least light over that of the first frame", _SIMULATED)
    gain_most: float = _constant(12.0, 6.0, 20.0, "most light over that of the first frame", _SIMULATED)
    agrees_noise: float = _constant(2.5, 2.0, 4.0, "residual of a pixel that still agrees, over the noise", _SIMULATED)
    agrees_share: float = _constant(0.25, 0.15, 0.35, "and in parts of the structure", _SIMULATED)
    covered_noise: float = _constant(5.0, 4.0, 7.0, "deviation of a region's own pixels from which on something "
        "else is seen there, over the noise", _SIMULATED)
    covered_structure_share: float = _constant(0.2, 0.1, 0.3, "and in parts of the structure", _SIMULATED)
    weight_kept: float = _constant(0.7, 0.5, 0.9, "weight that the patch and its edge keep whatever is learnt",
        _SIMULATED)
    weights_first_frames: int = _constant(4, 2, 10, "frames that the weights of the start count like", _SIMULATED)
    weights_frames: int = _constant(20, 10, 50, "frames that weights are a mean over", _SIMULATED)
    # The outline of a region
    outline_parts: int = _constant(24, 12, 36, "parts of a turn in which edges are compared", _SIMULATED)
    outline_clear_noise: float = _constant(6.0, 4.0, 10.0, "step of brightness over the noise from which a part has "
        "an edge", _SIMULATED)
    outline_known_share: float = _constant(0.25, 0.1, 0.5, "share of the outline without which nothing is said",
        _SIMULATED)
    outline_gone_share: float = _constant(0.35, 0.2, 0.5, "share of its usual height below which an edge is gone",
        _SIMULATED)
    outline_faint_share: float = _constant(0.25, 0.1, 0.4, "share of its first height below which there is no edge "
        "to lose", _SIMULATED)
    outline_light_quantile: float = _constant(0.85, 0.7, 0.95, "quantile of the heights that tells how the light of "
        "all changed", _SIMULATED)
    outline_light_least: float = _constant(0.25, 0.1, 0.5, "least such light", _SIMULATED)
    outline_rate: float = _constant(0.25, 0.1, 0.5, "part of the heights of a frame that is remembered", _SIMULATED)
    outline_height_most: float = _constant(1.5, 1.2, 3.0, "largest height that is", _SIMULATED)
    outline_lost_share: float = _constant(0.62, 0.5, 0.75, "share of the outline that may lose its edges at once: "
        "the edge to a neighbour stays if a region vanishes", _SIMULATED)
    # The scene
    cut_correlation: float = _constant(0.5, 0.3, 0.7, "correlation of two frames in a row below which the scene is "
        "another one", _SIMULATED)
    blank_dn: float = _constant(0.7, 0.3, 1.5, "standard deviation of a very small picture of a frame below which "
        "nothing is seen", _SIMULATED)
    scene_clear_noise: float = _constant(4.0, 2.0, 8.0, "standard deviation over its noise with which a scene shows "
        "where a plain region is", _SIMULATED)
    scene_points: int = _constant(12, 8, 30, "least points that tell how a scene moves", _SIMULATED)
    scene_corner: float = _constant(0.0005, 0.0001, 0.002, "least eigenvalue of a corner that is followed", _SIMULATED)
    scene_contrast_dn: float = _constant(3.0, 1.0, 6.0, "local contrast below which it is not made the same "
        "everywhere", _SIMULATED)
    scene_with_px: float = _constant(1.0, 0.5, 2.0, "distance in pixels of the small frame within which a point "
        "moves with the scene", _SIMULATED)
    scene_share: float = _constant(0.2, 0.1, 0.4, "share of the points that must", _SIMULATED)
    scene_share_new: float = _constant(0.5, 0.3, 0.7, "share below which new points are chosen", _SIMULATED)
    scene_lead_share: float = _constant(0.2, 0.1, 0.4, "lead in this share of another motion over rest, and over "
        "that of the frame before", _SIMULATED)
    scene_light_dn: float = _constant(1.0, 0.5, 3.0, "median below which light tells nothing", _SIMULATED)
    scene_light_jump: float = _constant(1.6, 1.3, 2.0, "factor from which on the light of the whole scene changed "
        "at once, whatever its contrast did", _SIMULATED)
    scene_every_frames: int = _constant(4, 1, 8, "frames after which points are followed if nothing needed them "
        "before", _COST)
    # Search in the whole frame
    search_side_px: int = _constant(24, 16, 48, "longest side of what is searched for, in pixels of the reduced "
        "frame", _COST)
    search_frame_px: int = _constant(960, 480, 1920, "longest side of that frame", _COST)
    search_correlation: float = _constant(0.35, 0.2, 0.5, "least correlation of a position that is looked at",
        _SIMULATED)
    search_peaks: int = _constant(4, 2, 8, "positions of each look and size", _COST)
    search_apart_share: float = _constant(0.3, 0.2, 0.5, "distance of positions from each other, in parts of the "
        "size", _SIMULATED)
    search_aligned: int = _constant(5, 3, 10, "positions of the whole frame that are aligned", _COST)
    repeats_aligned: int = _constant(48, 16, 96, "positions of the first frame that are looked at for one that "
        "looks the same", _SIMULATED)
    # The correlation filter
    filter_window: float = _constant(2.5, 2.0, 4.0, "side of the filter's window over that of the region", _REAL)
    filter_margin_template_px: float = _constant(16.0, 8.0, 32.0, "least that this is more than the region's", _REAL)
    filter_rate: float = _constant(0.05, 0.02, 0.1, "part of what is new in a frame that is learned", _REAL)
    filter_every_frames: int = _constant(4, 1, 10, "frames after which a region that looks as before is learned", _COST)
    filter_regular: float = _constant(0.1, 0.01, 1.0, "regularisation, over the mean power of the features", _REAL)
    filter_size_step: float = _constant(1.04, 1.02, 1.08, "factor of the sizes that are tried", _REAL)
    filter_size_worth: float = _constant(0.98, 0.9, 1.0, "worth of the answer at another size", _REAL)
    filter_first: float = _constant(0.4, 0.3, 0.6, "answer of the first filter from which a region is seen there",
        _REAL)
    filter_recent: float = _constant(0.3, 0.2, 0.5, "and of the one that has learned since", _REAL)
    filter_agrees: float = _constant(0.3, 0.2, 0.5, "answer of the first one without which a poor fit is not "
        "believed", _REAL)
    filter_inner: float = _constant(0.7, 0.5, 0.9, "correlation of the region's own features from which it is found "
        "again", _REAL)
    filter_near: float = _constant(0.35, 0.2, 0.6, "distance of an alignment from where the filter answers, over "
        "the size", _REAL)
    filter_moved: float = _constant(0.1, 0.05, 0.3, "distance from which the filter sees it elsewhere, over the "
        "size", _REAL)
    filter_covered_share: float = _constant(0.2, 0.1, 0.4, "share of it that differs where the filter sees it, from "
        "which it is covered", _REAL)
    filter_fit_quality: float = _constant(0.7, 0.55, 0.85, "quality from which the alignment is taken there", _REAL)
    filter_again: float = _constant(0.5, 0.4, 0.7, "answer of the first one from which a lost region is found again",
        _REAL)
    # Confirmation
    lost_quality: float = _constant(0.55, 0.5, 0.7, "quality below which a region is not there", _SIMULATED)
    search_quality: float = _constant(0.8, 0.7, 0.9, "quality from which a position of the whole frame is believed",
        _SIMULATED)
    good_quality: float = _constant(0.85, 0.8, 0.95, "quality that needs no other confirmation", _SIMULATED)
    covered_share: float = _constant(0.05, 0.02, 0.1, "share of a region that may be covered before nothing is "
        "measured in it", _SIMULATED)
    lead_quality: float = _constant(0.1, 0.05, 0.2, "lead in quality of a position far off over the next best one",
        _SIMULATED)
    reach_share: float = _constant(0.25, 0.15, 0.5, "distance around the expected position that is looked at, in "
        "parts of the window", _SIMULATED)
    reach_px: float = _constant(12.0, 8.0, 24.0, "and at least", _SIMULATED)
    usual_frames: int = _constant(10, 5, 30, "frames over which the usual quality is a mean, about", _SIMULATED)
    newer_lead_quality: float = _constant(0.1, 0.05, 0.2, "lead in quality of the last confirmed look over the "
        "first one with which it is believed", _SIMULATED)
    newer_below_quality: float = _constant(0.75, 0.6, 0.85, "quality of the first look below which the present one "
        "is remembered", _SIMULATED)
    newer_frames: int = _constant(2, 1, 5, "frames without a sudden change that this takes", _SIMULATED)
    sudden_share: float = _constant(0.05, 0.02, 0.1, "share of a region whose pixels may change from frame to frame "
        "while its look is remembered", _SIMULATED)
    in_image_share: float = _constant(0.4, 0.3, 0.7, "share of the template that must lie in the image", _SIMULATED)
    size_step: float = _constant(1.25, 1.1, 1.4, "largest change of size from frame to frame", _SIMULATED)
    size_least: float = _constant(0.15, 0.1, 0.3, "smallest size over the first one", _SIMULATED)
    size_most: float = _constant(8.0, 4.0, 12.0, "largest size over the first one", _SIMULATED)
    stretch_step: float = _constant(1.1, 1.05, 1.2, "largest change of its proportions from frame to frame", _SIMULATED)
    turn_step_rad: float = _constant(0.25, 0.1, 0.4, "largest turn from frame to frame", _SIMULATED)
    tilt_step: float = _constant(0.05, 0.02, 0.1, "largest change of perspective over half its size from frame to "
        "frame", _SIMULATED)
    # State of a region
    steady_quality: float = _constant(0.08, 0.04, 0.15, "fall of the quality in one frame up to which a position "
        "near the expected one is believed", _SIMULATED)
    alike_share: float = _constant(0.5, 0.3, 0.5, "where several positions look alike: distance from the expected "
        "one, over that to the next, at which none is taken", _SIMULATED)
    alike_again_share: float = _constant(0.35, 0.2, 0.5, "and after a loss", _SIMULATED)
    alike_moved_share: float = _constant(0.5, 0.3, 0.5, "and for what it may have moved meanwhile", _SIMULATED)
    back_frames: int = _constant(3, 1, 10, "frames of its motion within which what left the image comes back from "
        "where it left", _SIMULATED)
    below_usual_quality: float = _constant(0.1, 0.05, 0.2, "what a region that is found again may lack of its usual "
        "quality", _SIMULATED)
    velocity_rate: float = _constant(0.6, 0.3, 0.9, "share of the last step in the motion that is expected next",
        _SIMULATED)
    changing_quality: float = _constant(0.8, 0.7, 0.9, "usual quality below which an object changes its looks",
        _SIMULATED)
    changing_again_quality: float = _constant(0.92, 0.85, 0.97, "quality from which that is found again", _SIMULATED)
    again_light: float = _constant(1.6, 1.3, 2.5, "largest change of the light of a region that is found again "
        "elsewhere", _SIMULATED)
    # Several regions
    as_good_quality: float = _constant(0.1, 0.05, 0.2, "quality that a position may lack which a region that moves "
        "along shows", _SIMULATED)
    together_px: float = _constant(1.5, 0.8, 3.0, "difference of the motions of two regions that move together, as "
        "a rule", _SIMULATED)
    jump_px: float = _constant(6.0, 3.0, 10.0, "difference by which one of them jumps", _SIMULATED)
    doubt_px: float = _constant(0.5, 0.3, 1.0, "distance from where another one's motion carries a region from "
        "which it is doubted", _SIMULATED)
    doubt_usual: float = _constant(3.0, 2.0, 5.0, "and times the usual one", _SIMULATED)
    together_rate: float = _constant(0.2, 0.1, 0.4, "part of what is new in a frame that is remembered", _SIMULATED)
    # A plain region of the background
    background_noise: float = _constant(6.0, 4.0, 8.0, "deviation of a pixel from which on something else is seen "
        "there, over the noise", _SIMULATED)
    background_share: float = _constant(0.12, 0.08, 0.2, "and in parts of its brightness", _SIMULATED)
    background_sudden_share: float = _constant(0.2, 0.1, 0.4, "change of brightness against that of the scene "
        "between two frames that only another thing explains", _SIMULATED)
    background_contrast: float = _constant(2.0, 1.0, 4.0, "times the contrast of what is faint that a scene must "
        "have for a region to be a plain part of it", _CODED)
    background_moves_frames: int = _constant(3, 2, 6, "frames in which its surroundings are seen elsewhere before "
        "it is taken for a part of an object that moves", _SIMULATED)
    # fmt: on

    def __post_init__(self) -> None:
        for constant in fields(self):
            value, least, most = getattr(self, constant.name), constant.metadata["least"], constant.metadata["most"]
            if not least <= value <= most:
                raise InputError(
                    f"tracking constant {constant.name} is {value:g}: choose one from {least:g} to {most:g}"
                )


#: The constants in use.
SETTINGS = TrackingSettings()
