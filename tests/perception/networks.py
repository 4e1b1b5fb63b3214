"""Tiny ONNX networks in the layouts of real exports: what is painted in pure red is a car, in pure blue a person.

Two candidates answer, one per colour, with a box of fixed place in the input; all others score 0.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIDE = 64  # of the static input, px
STRIDES = (8, 16, 32)


def cells(height, width):
    return sum((height // s) * (width // s) for s in STRIDES)


def _constant(name, value):
    return numpy_helper.from_array(np.asarray(value), name)


def colour_network(
    path, layout="v8", names="{0: 'car', 1: 'person'}", score=0.9, dynamic=False, box=(0, 0, SIDE, SIDE)
):
    """Write a network whose prototypes are the masks of red and blue, 1 where the colour is and -1 elsewhere.

    Each candidate has the coefficient of its own prototype; both have the same `box`, x0, y0, x1, y1 in the input.
    """
    side = SIDE
    x0, y0, x1, y1 = box
    count = cells(side, side) * (3 if layout == "v5" else 1)
    first = 5 if layout == "v5" else 4
    table = np.zeros((count, first + 2 + 2), np.float32)
    for row, scale in ((0, 1.0), (1, 0.9)):
        table[row, :4] = [(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0]
        if layout == "v5":
            table[row, 4] = 1.0
        table[row, first + row] = score * scale
        table[row, first + 2 + row] = 10.0
    answer = table[None] if layout == "v5" else table.T[None]
    mix = np.array([[1, -1, -1], [-1, -1, 1]], np.float32).reshape(2, 3, 1, 1)  # from R, G, B
    nodes = [
        helper.make_node("AveragePool", ["images"], ["small"], kernel_shape=[4, 4], strides=[4, 4]),
        helper.make_node("Conv", ["small", "mix"], ["mixed"]),
        helper.make_node("Sub", ["mixed", "half"], ["output1"]),
        helper.make_node("Identity", ["table"], ["output0"]),
    ]
    size = ["height", "width"] if dynamic else [side, side]
    coarse = [None, None] if dynamic else [side // 4, side // 4]
    graph = helper.make_graph(
        nodes,
        "colours",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, *size])],
        [
            helper.make_tensor_value_info("output0", TensorProto.FLOAT, list(answer.shape)),
            helper.make_tensor_value_info("output1", TensorProto.FLOAT, [1, 2, *coarse]),
        ],
        [_constant("mix", mix), _constant("half", np.float32(0.5)), _constant("table", answer)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if names is not None:
        helper.set_model_props(model, {"names": names})
    onnx.save(model, str(path))
    return path


def other_network(path, output_shapes, input_shape=(1, 3, SIDE, SIDE)):
    """Write a network that answers with zeros of the given shapes."""
    nodes, outputs, constants = [], [], []
    for i, shape in enumerate(output_shapes):
        constants.append(_constant(f"zeros{i}", np.zeros(shape, np.float32)))
        nodes.append(helper.make_node("Identity", [f"zeros{i}"], [f"output{i}"]))
        outputs.append(helper.make_tensor_value_info(f"output{i}", TensorProto.FLOAT, list(shape)))
    image = helper.make_tensor_value_info("images", TensorProto.FLOAT, list(input_shape))
    graph = helper.make_graph(nodes, "zeros", [image], outputs, constants)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), str(path))
    return path
