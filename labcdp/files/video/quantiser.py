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
#: The same, as a part of the least change of a frequency that is coded: found with the known places of
#: ``benchmarks/tracking_coded.py``.
_FAINT_PART = 0.16
#: FFmpeg's AVVideoEncParams: number of blocks, where they begin, size of each, kind, base; in a block where its own is.
_HEADER, _OWN_AT = struct.Struct("@IQQii"), 16
_H264, _MPEG2 = 1, 2


def faint_dn(frames: Sequence[Any], codec: Any, bits: int) -> float:
    """Contrast below which the codec may not show where a thing is: see `labcdp.tracking.make_tracker`.

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
        Standard deviation in DN of 8 bits; 0 if the codec changed no number.
    """
    if not codec.lossy:
        return 0.0
    usual = _FAINT_DN if codec.intra_only else _FAINT_CHANGES_DN
    least = [_least_coded_dn(frame) for frame in frames]
    known = [one for one in least if one is not None]
    return min(usual, _FAINT_PART * max(known) / 2 ** (bits - 8)) if len(known) == len(least) else usual


def _least_coded_dn(frame: Any) -> float | None:
    """Least change of a frequency that is coded, in DN, by the mean quantiser; None where the decoder does not tell."""
    try:
        found = frame.side_data.get("VIDEO_ENC_PARAMS")
    # PyAV reads nothing of what comes with a frame if it does not know all of it.
    except ValueError:
        return None
    if found is None:
        return None
    data = bytes(found)
    n_blocks, begin, size, kind, base = _HEADER.unpack_from(data)
    if kind not in (_H264, _MPEG2) or n_blocks == 0:
        return None
    block = np.dtype({"names": ["own"], "formats": ["i4"], "offsets": [_OWN_AT], "itemsize": size})
    quantiser: float = base + float(np.frombuffer(data, block, n_blocks, begin)["own"].mean())
    # Steps are 0.625 at 0 and double with 6 in H.264 (ITU-T H.264, 8.5.9), and are given themselves of the others. The
    # encoders of the standards leave out less than 5/6 and, between key frames of MPEG-4, 5/4 of a step.
    return 5 / 6 * 0.625 * 2.0 ** (quantiser / 6) if kind == _H264 else 5 / 4 * quantiser
