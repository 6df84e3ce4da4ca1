"""Evaluation: sources, conversion and metrics joined to results."""

from .exact import ExactPrediction, PatchRates, patch_distribution, predict, predict_interval
from .exact_chain import predict_chain, transition_luminances
from .guess import guessed_conversion
from .maps import MapAnalysis, analyse_map
from .observe import ObservedSession, calibrate_session, observe_session
from .session import ContrastRow, PatchRow, SessionEvaluation, evaluate_session
from .simulation import PairRow, RegionRow, SimulationEvaluation, StageRow, evaluate_run, evaluate_stage
from .sweep import Sweep, run_sweep
from .sweep_axis import Axis, parse_axis, parse_value
from .thesis import ReproducedRow, ThesisReproduction, reproduce_thesis

__all__ = [
    "Axis",
    "ContrastRow",
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
    "analyse_map",
    "calibrate_session",
    "evaluate_run",
    "evaluate_session",
    "evaluate_stage",
    "guessed_conversion",
    "observe_session",
    "parse_axis",
    "parse_value",
    "patch_distribution",
    "predict",
    "predict_chain",
    "predict_interval",
    "reproduce_thesis",
    "run_sweep",
    "transition_luminances",
]
