"""Writes networks as ONNX files, layer by layer, from plain arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from autopilot.agent import STATE
from autopilot.detector import SCALES
from onnx import TensorProto, helper, numpy_helper

from . import detector_network
from .policy_network import AHEAD, OBSTACLES, PATCHES, ROUTE

Array = np.ndarray[Any, Any]
OPSET = 17


class Graph:
    """An ONNX graph as it grows."""

    def __init__(self) -> None:
        self._nodes: list[Any] = []
        self._weights: list[Any] = []

    def node(self, kind: str, inputs: list[str], name: str, **attributes: Any) -> str:
        """Adds a node; its only output has its name."""
        self._nodes.append(helper.make_node(kind, inputs, [name], name=name, **attributes))
        return name

    def weight(self, name: str, value: Array) -> str:
        """Adds an array."""
        self._weights.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def dense(self, x: str, name: str, layer: dict[str, Array]) -> str:
        """A layer of which each output sees all inputs."""
        weights = [self.weight(f"{name}.w", layer["w"]), self.weight(f"{name}.b", layer["b"])]
        return self.node("Gemm", [x, *weights], name)

    def conv(self, x: str, name: str, layer: dict[str, Array], stride: int) -> str:
        """A convolution with weights (rows, columns, before, after), padded by half its size."""
        kernel = layer["w"].transpose(3, 2, 0, 1)
        pad = 0 if kernel.shape[2] == stride else kernel.shape[2] // 2
        weights = [self.weight(f"{name}.w", kernel), self.weight(f"{name}.b", layer["b"])]
        return self.node("Conv", [x, *weights], name, strides=[stride] * 2, pads=[pad] * 4)

    def relu(self, x: str) -> str:
        """What of it is above zero."""
        return self.node("Relu", [x], f"{x}.relu")

    def save(self, path: Path, inputs: list[Any], outputs: list[Any]) -> None:
        """Checks the graph and writes it."""
        graph = helper.make_graph(self._nodes, path.stem, inputs, outputs, self._weights)
        opset = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, opset_imports=opset, ir_version=8)
        onnx.checker.check_model(model, full_check=True)
        path.parent.mkdir(exist_ok=True)
        onnx.save(model, path)


def export_policy(params: dict[str, Any], path: Path) -> None:
    """Writes the policy: a bird's-eye view and a state go in, the mean action comes out."""
    graph = Graph()
    x = graph.node("Cast", ["birdview"], "numbers", to=TensorProto.FLOAT)
    for index, (size, before, after) in enumerate(PATCHES):
        layer = params[f"patch{index}"]
        scale = 255.0 if index == 0 else 1.0
        kernel = np.asarray(layer["w"]).reshape(size, size, before, after) / np.float32(scale)
        patch = {"w": kernel.astype(np.float32), "b": np.asarray(layer["b"])}
        x = graph.relu(graph.conv(x, f"patch{index}", patch, size))
    # Channels last, as the network has learned.
    x = graph.node("Transpose", [x], "last", perm=[0, 2, 3, 1])
    x = graph.relu(graph.dense(graph.node("Flatten", [x], "flat"), "view", params["view"]))
    near = graph.node("Concat", ["state", _profile(graph)], "near", axis=1)
    felt = graph.relu(graph.dense(near, "felt", params["felt"]))
    both = graph.node("Concat", [x, felt], "beside", axis=1)
    hidden = graph.relu(graph.dense(both, "both", params["both"]))
    graph.dense(hidden, "action", params["action"])
    graph.save(
        path,
        [
            helper.make_tensor_value_info("birdview", TensorProto.UINT8, [1, 6, 64, 64]),
            helper.make_tensor_value_info("state", TensorProto.FLOAT, [1, STATE]),
        ],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 2])],
    )


def _profile(graph: Graph) -> str:
    """What `policy_network.profile` says of the view, of which the node ``numbers`` has a float."""
    scale = graph.weight("whole", np.float32(1 / 255))
    seen = graph.node("Mul", ["numbers", scale], "seen")

    def channels(name: str, first: int, last: int) -> str:
        bounds = {"from": [first, 0], "to": [last, AHEAD], "of": [1, 2]}
        parts = [graph.weight(f"{name}.{key}", np.array(it)) for key, it in bounds.items()]
        return graph.node("Slice", [seen, *parts], name)

    route = channels("route", ROUTE, ROUTE + 1)
    met = graph.node("Mul", [route, channels("obstacles", OBSTACLES, OBSTACLES + 3)], "met")
    rows = graph.node("ReduceMax", [met], "rows", axes=[3], keepdims=0)
    # A maximum over all rows below is a pool that looks down to the lowest one.
    pads = [0, AHEAD - 1]
    blocked = graph.node("MaxPool", [rows], "blocked", kernel_shape=[AHEAD], pads=pads)
    return graph.node("Flatten", [blocked], "profile", axis=1)


def export_detector(params: dict[str, Any], path: Path) -> None:
    """Writes the detector: a picture as the camera takes it goes in, all cells come out."""
    graph = Graph()
    numbers = graph.node("Cast", ["picture"], "numbers", to=TensorProto.FLOAT)
    x = graph.node("Transpose", [numbers], "first", perm=[0, 3, 1, 2])
    scale, middle = (
        graph.weight("scale", np.float32(1 / 255)),
        graph.weight("middle", np.float32(0.45)),
    )
    x = graph.node("Sub", [graph.node("Mul", [x, scale], "scaled"), middle], "centred")
    kept = {}
    for name, _, stride, before, after in detector_network.BACKBONE:
        y = graph.relu(graph.conv(x, name, params[name], stride))
        x = graph.node("Add", [x, y], f"{name}.sum") if stride == 1 and before == after else y
        kept[name] = x
    coarse = x
    twice = graph.weight("twice", np.array([1, 1, 2, 2], np.float32))
    for name, other in (("up_sixteenth", "sixteenth_more"), ("up_eighth", "eighth_more")):
        narrow = graph.relu(graph.conv(x, name, params[name], 1))
        options = {"mode": "nearest", "nearest_mode": "floor"}
        options["coordinate_transformation_mode"] = "asymmetric"
        large = graph.node("Resize", [narrow, "", twice], f"{name}.large", **options)
        x = graph.node("Add", [large, kept[other]], f"{name}.sum")
    outs = []
    for name, features in (("fine", x), ("coarse", coarse)):
        hidden = graph.relu(graph.conv(features, name, params[name], 1))
        out = graph.conv(hidden, f"{name}_out", params[f"{name}_out"], 1)
        last = graph.node("Transpose", [out], f"{name}.last", perm=[0, 2, 3, 1])
        shape = graph.weight(f"{name}.shape", np.array([-1, detector_network.OUTPUTS], np.int64))
        outs.append(graph.node("Reshape", [last, shape], f"{name}.cells"))
    graph.node("Concat", outs, "cells", axis=0)
    cells = sum((480 // it.stride) * (640 // it.stride) for it in SCALES)
    graph.save(
        path,
        [helper.make_tensor_value_info("picture", TensorProto.UINT8, [1, 480, 640, 3])],
        [
            helper.make_tensor_value_info(
                "cells", TensorProto.FLOAT, [cells, detector_network.OUTPUTS]
            )
        ],
    )
