"""The paper's equations as symbols, derived by sympy and evaluated with 60 digits: the slow twin of geometry/observation.

Nothing of Propositions 1 and 2 is written down here: derivatives come from differentiating Eq. 2 and Eq. 6 to 8.
"""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
import sympy

NAMES = ("theta_c", "p_c", "theta_o", "p_o", "v")


def rodrigues(theta: sympy.Matrix) -> sympy.Matrix:
    """exp(hat(theta)) (proof of Proposition 2)."""
    angle = sympy.sqrt(theta.dot(theta))
    x, y, z = theta
    hat = sympy.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return sympy.eye(3) + hat * (sympy.sin(angle) / angle) + hat * hat * ((1 - sympy.cos(angle)) / angle**2)


@cache
def _equations():
    states = {name: sympy.Matrix(sympy.symbols(f"{name}_0:3", real=True)) for name in NAMES}
    fx, fy, cx, cy, skew = sympy.symbols("fx fy cx cy skew", real=True)
    r_c, r_o = rodrigues(states["theta_c"]), rodrigues(states["theta_o"])
    gamma = r_c.T * (r_o * states["v"] + states["p_o"] - states["p_c"])
    pixel = sympy.Matrix([[fx, skew, cx], [0, fy, cy]]) * (gamma / gamma[2])
    symbols = [s for name in NAMES for s in states[name]] + [fx, fy, cx, cy, skew]
    derivatives = [pixel.jacobian(states[name]) for name in NAMES]
    return sympy.lambdify(symbols, [gamma, pixel, *derivatives], modules="mpmath", cse=True)


def pixel_and_derivatives(camera, theta_c, p_c, theta_o, p_o, v):
    """gamma (3,), y (2,), and dy/d(alpha) (2, 3) for each of NAMES, of one point; no angle may be 0."""
    with mpmath.workdps(60):
        values = [mpmath.mpf(float(x)) for part in (theta_c, p_c, theta_o, p_o, v) for x in part]
        values += [mpmath.mpf(float(x)) for x in (camera.fx, camera.fy, camera.cx, camera.cy, camera.skew)]
        gamma, pixel, *derivatives = (np.array(m.tolist(), float) for m in _equations()(*values))
    return gamma[:, 0], pixel[:, 0], dict(zip(NAMES, derivatives, strict=True))


@cache
def _right_jacobian():
    theta = sympy.Matrix(sympy.symbols("t0:3", real=True))
    rotation = rodrigues(theta)
    columns = []
    for symbol in theta:
        spin = rotation.T * rotation.diff(symbol)  # hat(J_r e_k)
        columns.append(sympy.Matrix([spin[2, 1], spin[0, 2], spin[1, 0]]))
    return sympy.lambdify(list(theta), sympy.Matrix.hstack(*columns), modules="mpmath", cse=True)


def right_jacobian(theta):
    """J_r (3, 3) from R^T dR/d(theta_k); the angle may not be 0."""
    with mpmath.workdps(60):
        return np.array(_right_jacobian()(*(mpmath.mpf(float(t)) for t in theta)).tolist(), float)


def mask_loss_and_gradient(observed, predicted):
    """L_mask and its gradient over predicted, both (h, w), exact for rationals."""
    h, w = observed.shape
    s = sympy.Matrix(h, w, lambda i, j: sympy.Rational(float(observed[i, j])))
    p = sympy.Matrix(h, w, lambda i, j: sympy.Symbol(f"p_{i}_{j}", positive=True))
    both = s.multiply_elementwise(p)
    loss = -sum(both) / sum(s + p - both)
    at = {p[i, j]: sympy.Rational(float(predicted[i, j])) for i in range(h) for j in range(w)}
    gradient = [[float(sympy.diff(loss, p[i, j]).subs(at)) for j in range(w)] for i in range(h)]
    return float(loss.subs(at)), np.array(gradient)


def keypoint_loss_and_gradient(observed, predicted, vis):
    """L_kps and its gradient over predicted (n, 2)."""
    p = sympy.Matrix(*predicted.shape, lambda i, j: sympy.Symbol(f"p_{i}_{j}", real=True))
    gap = sympy.Matrix(observed).T - p.T * sympy.Matrix(vis)  # the paper's points are columns
    loss = sum(g**2 for g in gap)
    at = dict(zip(list(p), [float(x) for x in predicted.ravel()], strict=True))
    gradient = [float(sympy.diff(loss, symbol).subs(at)) for symbol in p]
    return float(loss.subs(at)), np.array(gradient).reshape(predicted.shape)
