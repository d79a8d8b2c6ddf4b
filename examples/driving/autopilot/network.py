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


Shapes = Mapping[str, tuple[int, ...]]


class Network:
    """A network with given inputs and one output, each a name and a shape."""

    def __init__(self, path: Path, inputs: Shapes, output: Shapes) -> None:
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        if not path.is_file():
            raise ModelError(f"the model {path} does not exist")
        try:
            session = ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # What ONNX Runtime raises has no common class.
            raise ModelError(f"the model {path} cannot be read: {_first_line(error)}") from None
        for what, wanted, nodes in (
            ("inputs", inputs, session.get_inputs()),
            ("outputs", output, session.get_outputs()),
        ):
            has = {it.name: tuple(it.shape) for it in nodes}
            if has != dict(wanted):
                raise ModelError(f"the model {path} has the {what} {has}, not {dict(wanted)}")
        self._session, self._outputs = session, list(output)

    def run(self, **inputs: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """The output for these inputs."""
        (result,) = self._session.run(self._outputs, inputs)
        return np.asarray(result, np.float32)


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
