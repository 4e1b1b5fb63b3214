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
    path,
    layout="v8",
    names="{0: 'car', 1: 'person'}",
    score=0.9,
    dynamic=False,
    box=(0, 0, SIDE, SIDE),
    metadata=None,
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
    said = (metadata or {}) | ({} if names is None else {"names": names})
    helper.set_model_props(model, said | ({"imgsz": f"[{side}, {side}]"} if dynamic else {}))
    onnx.save(model, str(path))
    return path


def other_network(path, output_shapes, input_shape=(1, 3, SIDE, SIDE), metadata=None):
    """Write a network that answers with zeros of the given shapes."""
    nodes, outputs, constants = [], [], []
    for i, shape in enumerate(output_shapes):
        constants.append(_constant(f"zeros{i}", np.zeros(shape, np.float32)))
        nodes.append(helper.make_node("Identity", [f"zeros{i}"], [f"output{i}"]))
        outputs.append(helper.make_tensor_value_info(f"output{i}", TensorProto.FLOAT, list(shape)))
    image = helper.make_tensor_value_info("images", TensorProto.FLOAT, list(input_shape))
    graph = helper.make_graph(nodes, "zeros", [image], outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata or {})
    onnx.save(model, str(path))
    return path


def listing_network(
    path,
    outputs,
    masks,
    metadata=None,
    size=(SIDE, SIDE),
    mix=None,
    cell=4,
    inner=None,
    dtype=None,
    squeeze=False,
    step=None,
):
    """Write a network whose `outputs` (arrays by name) are constants; output `masks` (1, N, h, w) follows the colours.

    `mix` (N, 4) gives weights of the input's three channels and an offset for each mask. `size` None leaves the size
    open. With `inner` (name, count) the output of that name depends on the best `count` of the input's 8 px cells, as
    in networks that choose their best themselves. With `squeeze` the input is (3, h, w) and masks are (N, 1, h, w).
    `step` is an operator with a constant that comes before all others.
    """
    nodes, constants, infos = [], [], []
    image = "images"
    if dtype == TensorProto.UINT8:
        nodes.append(helper.make_node("Cast", ["images"], ["numbers"], to=TensorProto.FLOAT))
        image = "numbers"
    if step is not None:
        constants.append(_constant("step", np.asarray(step[1], np.float32)))
        nodes.append(helper.make_node(step[0], [image, "step"], ["stepped"]))
        image = "stepped"
    mix = np.asarray(mix, np.float32)
    if squeeze:
        constants.append(_constant("first", np.array([0], np.int64)))
        nodes.append(helper.make_node("Unsqueeze", ["images", "first"], ["batched"]))
        image = "batched"
    drawn = "drawn" if squeeze else masks
    nodes.append(helper.make_node("AveragePool", [image], ["small"], kernel_shape=[cell, cell], strides=[cell, cell]))
    nodes.append(helper.make_node("Conv", ["small", "mix", "offset"], [drawn]))
    if squeeze:
        nodes.append(helper.make_node("Transpose", ["drawn"], [masks], perm=[1, 0, 2, 3]))
    constants += [_constant("mix", mix[:, :3].reshape(-1, 3, 1, 1)), _constant("offset", mix[:, 3].copy())]
    for name, value in outputs.items():
        constants.append(_constant(f"{name}_value", value))
        if inner is not None and inner[0] == name:
            nodes += _best_cells(image, inner[1], f"{name}_value", name, constants)
        else:
            nodes.append(helper.make_node("Identity", [f"{name}_value"], [name]))
        kind = helper.np_dtype_to_tensor_dtype(np.asarray(value).dtype)
        dims = [None] * value.ndim if size is None else list(value.shape)
        infos.append(helper.make_tensor_value_info(name, kind, dims))
    grid = [None, None] if size is None else [n // cell for n in size]
    count = [None, None] if squeeze else [1, len(mix)]
    infos.append(helper.make_tensor_value_info(masks, TensorProto.FLOAT, [*count, *grid]))
    dims = ["batch", 3, "height", "width"] if size is None else [1, 3, *size]
    dims = dims[1:] if squeeze else dims
    graph = helper.make_graph(
        nodes, "listing", [helper.make_tensor_value_info("images", dtype or TensorProto.FLOAT, dims)], infos, constants
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata or {})
    onnx.save(model, str(path))
    return path


def _best_cells(image, count, table, name, constants):
    """Nodes that add nothing to a table, by way of a TopK that inputs with fewer cells than `count` do not survive."""
    constants += [
        _constant("count", np.array([count], np.int64)),
        _constant("line", np.array([-1], np.int64)),
        _constant("no", np.float32(0)),
    ]
    return [
        helper.make_node("AveragePool", [image], ["cells"], kernel_shape=[8, 8], strides=[8, 8]),
        helper.make_node("ReduceMean", ["cells"], ["one_channel"], axes=[1]),
        helper.make_node("Reshape", ["one_channel", "line"], ["flat"]),
        helper.make_node("TopK", ["flat", "count"], ["best", "places"]),
        helper.make_node("ReduceMean", ["best"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "no"], ["nothing"]),
        helper.make_node("Add", [table, "nothing"], [name]),
    ]
