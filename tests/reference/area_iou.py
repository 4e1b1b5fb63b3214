"""The slow twin of the exact gradient: IoU of areas by supersampling, and its central differences."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Camera, Pose, exp_so3, render


def finer(camera: Camera, times: int) -> Camera:
    """The camera with `times` x `times` pixels in place of each."""
    return Camera(
        camera.width * times,
        camera.height * times,
        camera.fx * times,
        camera.fy * times,
        (camera.cx + 0.5) * times - 0.5,
        (camera.cy + 0.5) * times - 0.5,
        camera.skew * times,
    )


def shares(camera, pose, vertices, faces, rect, times):
    """How much of each pixel of `rect` (x0, y0, width, height) the mesh covers, by counting samples."""
    x0, y0, width, height = rect
    window = (x0 * times, y0 * times, width * times, height * times)
    fine = render(finer(camera, times), [(pose, vertices, faces)], window).mask
    return fine.reshape(height, times, width, times).mean((1, 3))


def areas(camera, pose, vertices, faces, observed, rect, times):
    """Area of the overlap with the observed mask and of the drawn mask within `rect`, pixels."""
    share = shares(camera, pose, vertices, faces, rect, times)
    x0, y0, width, height = rect
    return (share * observed[y0 : y0 + height, x0 : x0 + width]).sum(), share.sum()


def box(camera, pixels, margin=2):
    """Rectangle of image pixels around points."""
    low = np.clip(np.floor(pixels.min(0)).astype(int) - margin, 0, [camera.width - 1, camera.height - 1])
    high = np.clip(np.ceil(pixels.max(0)).astype(int) + margin + 1, low + 1, [camera.width, camera.height])
    return (*low.tolist(), *(high - low).tolist())


def loss_of(both, drawn, observed):
    return -both / (drawn + observed.sum() - both)


# Small against a pixel, within which the loss is smooth, and more than a sample, so that counting does not drown it.
STEP_SAMPLES = 1.6


def samples_a_pixel(rect, most):
    """How fine a window can be drawn with `most` samples in all, to a side of a pixel."""
    return int(np.clip(np.sqrt(most / (rect[2] * rect[3])), 4, 96))


def central(loss, step):
    return (loss(step) - loss(-step)) / (2 * step)


def vertex_gradient(camera, pose, vertices, faces, observed, chosen, *, most=1_000_000):
    """dL/dV of the `chosen` vertices (n, 3): only pixels around the faces of a vertex change with it."""
    image = (0, 0, camera.width, camera.height)
    both, drawn = areas(camera, pose, vertices, faces, observed, image, 8)
    out = np.zeros((len(chosen), 3))
    in_camera = pose.transform(vertices)
    for row, vertex in enumerate(chosen):
        ring = np.unique(faces[(faces == vertex).any(1)])
        rect = box(camera, camera.project(in_camera[ring]))
        times = samples_a_pixel(rect, most)
        step = STEP_SAMPLES / times * in_camera[vertex, 2] / camera.fx
        for axis in range(3):

            def local(by, vertex=vertex, axis=axis, rect=rect, times=times):
                moved = vertices.copy()
                moved[vertex, axis] += by
                return np.array(areas(camera, pose, moved, faces, observed, rect, times))

            d_both, d_drawn = central(local, step)
            out[row, axis] = central(
                lambda by, b=d_both, d=d_drawn: loss_of(both + by * b, drawn + by * d, observed), step
            )
    return out


def pose_gradient(camera, pose, vertices, faces, observed, *, step_px=0.05, most=4_000_000):
    """dL over a right perturbation of `pose`, (translation, rotation)."""
    in_camera = pose.transform(vertices)
    before = in_camera[:, 2].min() > 0.2
    rect = box(camera, camera.project(in_camera), margin=4) if before else (0, 0, camera.width, camera.height)
    times = samples_a_pixel(rect, most)
    # a shift of the whole by a step, or a turn that moves its ends so far
    step = step_px * in_camera[:, 2].mean() / camera.fx
    steps = np.array([step] * 3 + [step / np.abs(vertices).max()] * 3)

    def loss(xi):
        moved = Pose(pose.rotation @ exp_so3(xi[3:]), pose.translation + pose.rotation @ xi[:3])
        return loss_of(*areas(camera, moved, vertices, faces, observed, rect, times), observed)

    return np.array([central(lambda by, k=k: loss(np.eye(6)[k] * by), steps[k]) for k in range(6)])
