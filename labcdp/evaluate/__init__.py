"""Evaluation: sources, conversion and metrics joined to results."""

from .bracket_session import response_of_session
from .calibrate import calibrate_session
from .characterise import characterise_index, characterise_session
from .corrections import Corrections, corrections_of, corrections_of_lens
from .dark_session import with_darkness
from .exact import ExactPrediction, PatchRates, patch_distribution, predict, predict_interval
from .exact_chain import predict_chain, transition_luminances
from .flat_session import measure_corrections, require_same_optics
from .guess import guessed_conversion
from .maps import MapAnalysis, analyse_map
from .observe import ObservedSession, observe_session
from .session import ContrastRow, PatchRow, SessionEvaluation, calibration_values, evaluate_session
from .simulation import PairRow, RegionRow, SimulationEvaluation, StageRow, evaluate_run, evaluate_stage
from .sweep import Sweep, run_sweep
from .sweep_axis import Axis, parse_axis, parse_value
from .thesis import ReproducedRow, ThesisReproduction, reproduce_thesis
from .twin import TwinResult, twin_session

__all__ = [
    "Axis",
    "ContrastRow",
    "Corrections",
    "ExactPrediction",
    "MapAnalysis",
    "ObservedSession",
    "PairRow",
    "PatchRates",
    "PatchRow",
    "RegionRow",
    "ReproducedRow",
    "SessionEvaluation",
    "SimulationEvaluation",
    "StageRow",
    "Sweep",
    "ThesisReproduction",
    "TwinResult",
    "analyse_map",
    "calibrate_session",
    "calibration_values",
    "characterise_index",
    "characterise_session",
    "corrections_of",
    "corrections_of_lens",
    "evaluate_run",
    "evaluate_session",
    "evaluate_stage",
    "guessed_conversion",
    "measure_corrections",
    "observe_session",
    "parse_axis",
    "parse_value",
    "patch_distribution",
    "predict",
    "predict_chain",
    "predict_interval",
    "reproduce_thesis",
    "require_same_optics",
    "response_of_session",
    "run_sweep",
    "transition_luminances",
    "twin_session",
    "with_darkness",
]
