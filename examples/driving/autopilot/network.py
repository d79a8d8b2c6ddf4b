"""Networks in ONNX files, run by ONNX Runtime on one thread."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnxruntime as ort  # type: ignore[import-untyped]

MODELS = Path(__file__).resolve().parents[1] / "models"


class ModelError(Exception):
    """A model file cannot be used; the message says which and why."""


class Network:
    """A network with given inputs, by name and shape, and one output."""

    def __init__(self, path: Path, inputs: Mapping[str, tuple[int, ...]], output: str) -> None:
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        if not path.is_file():
            raise ModelError(f"the model {path} does not exist")
        try:
            session = ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # What ONNX Runtime raises has no common class.
            raise ModelError(f"the model {path} cannot be read: {_first_line(error)}") from None
        has = {it.name: tuple(it.shape) for it in session.get_inputs()}
        if has != dict(inputs):
            raise ModelError(f"the model {path} has the inputs {has}, not {dict(inputs)}")
        if output not in {it.name for it in session.get_outputs()}:
            raise ModelError(f"the model {path} has no output {output!r}")
        self._session, self._output = session, output

    def run(self, **inputs: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """The output for these inputs."""
        (result,) = self._session.run([self._output], inputs)
        return np.asarray(result, np.float32)


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
