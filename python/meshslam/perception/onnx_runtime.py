"""ONNX Runtime, which runs the networks; the one place that imports it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

_SILENT = 3  # the runtime's own log: errors alone, which are exceptions anyway


def inference_session(path: Path, threads: int = 1) -> Any:  # noqa: ANN401 # untyped package
    """The session of a network's file on the CPU; whatever the runtime raises.

    From 1.29 on the runtime reports which models are run, on Linux, too, unless it is told not to before its import.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # slow to import: only those who run a network wait for it

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = _SILENT
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning threads starve other processes
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
