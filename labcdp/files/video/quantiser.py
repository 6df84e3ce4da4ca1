"""What a codec leaves out: contrasts that its decoded frames may not show where they are."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

#: Option of FFmpeg's decoders that hands out the parameters of H.264, MPEG-2 and MPEG-4 with each frame.
PARAMETERS = {"export_side_data": "venc_params"}
#: What is faint where each frame is coded by itself, and where changes are, of which a codec leaves out small ones;
#: standard deviation in DN of 8 bits.
_FAINT_DN, _FAINT_CHANGES_DN = 2.0, 4.0
#: FFmpeg's kinds of parameters, and what is faint in quantiser steps, found with the known places of
#: ``benchmarks/tracking_coded.py``. Encoders of MPEG-4 round more of a step to nothing.
_H264, _MPEG2 = 1, 2
_FAINT_STEPS = {_H264: 0.1, _MPEG2: 0.2}
#: Profile of H.264 whose numbers are stored as they are where the quantiser is 0.
_BYPASS_PROFILE = "High 4:4:4 Predictive"
#: FFmpeg's AVVideoEncParams: number of blocks, where they begin, size of each, kind, base; in a block where its own is.
_HEADER, _OWN_AT = struct.Struct("@IQQii"), 16


def is_lossless(frames: Sequence[Any], codec: Any, profile: str | None) -> bool:
    """Whether the codec changed no number: by its kind, or of H.264 by profile and quantiser (ITU-T H.264, 7.4.2.1.1).

    Parameters
    ----------
    frames : sequence of av.VideoFrame
        The first frames, decoded with `PARAMETERS`.
    codec : av.Codec
        Of them.
    profile : str or None
        FFmpeg's name of the codec's profile.
    """
    if not codec.lossy:
        return True
    return profile == _BYPASS_PROFILE and all(_quantiser(frame) == (_H264, 0.0) for frame in frames)


def faint_dn(frames: Sequence[Any], codec: Any, bits: int) -> float:
    """Contrast below which a codec with losses may not show where a thing is: see `labcdp.tracking.make_tracker`.

    Parameters
    ----------
    frames : sequence of av.VideoFrame
        The first frames, decoded with `PARAMETERS`. The coarsest of them counts: those between key frames are coarser.
    codec : av.Codec
        Of them.
    bits : int
        Of their numbers.

    Returns
    -------
    float
        Standard deviation in DN of 8 bits.
    """
    usual = _FAINT_DN if codec.intra_only else _FAINT_CHANGES_DN
    faint = [_faint_dn(frame) for frame in frames]
    known = [contrast for contrast in faint if contrast is not None]
    return min(usual, max(known) / 2 ** (bits - 8)) if len(known) == len(faint) else usual


def _faint_dn(frame: Any) -> float | None:
    """Return what is faint by the mean quantiser step of a frame, in its DN; None where the decoder does not tell."""
    read = _quantiser(frame)
    if read is None:
        return None
    kind, quantiser = read
    # In H.264 six more double the step, which is 0.625 at 0 (ITU-T H.264, 8.5.9); else it is the step itself.
    step_dn = 0.625 * 2.0 ** (quantiser / 6) if kind == _H264 else quantiser
    return _FAINT_STEPS[kind] * step_dn


def _quantiser(frame: Any) -> tuple[int, float] | None:
    """Return FFmpeg's kind of the parameters of a frame, and its mean quantiser; None where the decoder tells none."""
    try:
        parameters = frame.side_data.get("VIDEO_ENC_PARAMS")
    # PyAV reads nothing of what comes with a frame if it does not know all of it.
    except ValueError:
        return None
    if parameters is None:
        return None
    data = bytes(parameters)
    n_blocks, begin, size, kind, base = _HEADER.unpack_from(data)
    if kind not in _FAINT_STEPS or n_blocks == 0:
        return None
    block = np.dtype({"names": ["own"], "formats": ["i4"], "offsets": [_OWN_AT], "itemsize": size})
    return kind, base + float(np.frombuffer(data, block, n_blocks, begin)["own"].mean())
