"""What live drivers and broken detectors do to a stream, as changes of the arguments of one call of `process`."""

import inspect
import sys
from dataclasses import replace

import numpy as np

from meshslam.errors import MeshslamError
from meshslam.perception.masks import encode_mask
from meshslam.sequences import ImuSamples


class InjectedError(Exception):
    """A fault inside of the work on a frame, such as a bug or a solver that gives up would raise."""


class FaultInside:
    """Raises at the n-th call of a function of meshslam."""

    def __init__(self, after_calls):
        self.left, self.raised = after_calls, False

    def __enter__(self):
        sys.setprofile(self._seen)
        return self

    def __exit__(self, *_):
        sys.setprofile(None)

    def _seen(self, frame, event, _):
        code = frame.f_code
        if event != "call" or "/meshslam/" not in code.co_filename or "checkpoint" in code.co_filename:
            return
        if code.co_flags & inspect.CO_GENERATOR:  # nothing that is raised while one is closed goes anywhere
            return
        self.left -= 1
        if self.left == 0:
            self.raised = True
            raise InjectedError("in the middle")


def imu(item, change):
    given = item["imu"]
    arrays = [a.copy() for a in (given.times_s, given.angular_rate_rad_s, given.specific_force_m_s2)]
    return item | {"imu": ImuSamples(*change(*arrays))}


def first_detection(item, **changes):
    found = item["detections"]
    return item | {"detections": tuple(replace(d, **changes) if i == 0 else d for i, d in enumerate(found))}


def put(array, value, rows=slice(0, 1)):
    array[rows] = value
    return array


def keypoints(item, change):
    found = item["detections"]
    return item | {"detections": tuple(replace(d, keypoints=change(d.keypoints.copy())) for d in found)}


def fewer_keypoints(item):
    cut = [replace(d, keypoints=d.keypoints[:5], keypoint_scores=d.keypoint_scores[:5]) for d in item["detections"]]
    return item | {"detections": tuple(cut)}


def resized(item):
    small = np.ones((90, 280), np.uint8)
    changes = {"image_size": (90, 280), "segmentation": encode_mask(small)}
    return item | {"detections": tuple(replace(d, **changes) for d in item["detections"])}


REFUSED = {
    "time is NaN": lambda i: i | {"time_s": float("nan")},
    "time is None": lambda i: i | {"time_s": None},
    "time is text": lambda i: i | {"time_s": "1.0"},
    "time is infinite": lambda i: i | {"time_s": float("inf")},
    "time in ns": lambda i: i | {"time_s": (i["time_s"] + 1e6) * 1e9},
    "clock jumps ahead": lambda i: i | {"time_s": i["time_s"] + 3600.0},
    "clock jumps back": lambda i: i | {"time_s": i["time_s"] - 3600.0},
    "number goes back": lambda i: i | {"frame": i["frame"] - 2},
    "number is text": lambda i: i | {"frame": "7"},
    "samples on another clock": lambda i: imu(i, lambda t, w, f: (t + 1e6, w, f)),
    "samples in ns": lambda i: imu(i, lambda t, w, f: (t * 1e9, w, f)),
    "samples too late": lambda i: imu(i, lambda t, w, f: (t - 0.5, w, f)),
    "samples of wrong shape": lambda i: imu(i, lambda t, w, f: (t, w[:, :2], f)),
    "samples of other length": lambda i: imu(i, lambda t, w, f: (t, w[:-1], f)),
    "samples are no samples": lambda i: i | {"imu": [1, 2, 3]},
    "detections of a resized image": resized,
    "5 of 12 key points": fewer_keypoints,
    "a key point is NaN": lambda i: keypoints(i, lambda k: put(k, np.nan, slice(None))),
    "box is NaN": lambda i: first_detection(i, bbox=(float("nan"), 0.0, 10.0, 10.0)),
    "score is NaN": lambda i: first_detection(i, score=float("nan")),
    "mask is cut": lambda i: first_detection(i, segmentation={"size": [180, 560], "counts": "1"}),
    "mask is None": lambda i: first_detection(i, segmentation=None),
    "track is text": lambda i: first_detection(i, track_id="a"),
    "detections are no list": lambda i: i | {"detections": 5},
    "a detection is None": lambda i: i | {"detections": (None,)},
    "neither image nor detections": lambda i: i | {"detections": None},
    "image of another size": lambda i: i | {"image": np.zeros((10, 10, 3), np.uint8)},
    "image is text": lambda i: i | {"image": "image.png"},
}
BRIDGED = {
    "each sample twice": lambda i: imu(i, lambda *a: [np.repeat(x, 2, 0) for x in a]),
    "samples in reverse": lambda i: imu(i, lambda *a: [x[::-1] for x in a]),
    "a sample is NaN": lambda i: imu(i, lambda t, w, f: (t, w, put(f, np.nan, 3))),
    "a time far ahead": lambda i: imu(i, lambda t, w, f: (put(t, t[-1] + 500.0, 3), w, f)),
    "a time is NaN": lambda i: imu(i, lambda t, w, f: (put(t, np.nan, 3), w, f)),
    "a sample of 50 g": lambda i: imu(i, lambda t, w, f: (t, w, put(f, 490.0, 3))),
    "a sample of 100 rad/s": lambda i: imu(i, lambda t, w, f: (t, put(w, 100.0, 3), f)),
    "old samples come along": lambda i: imu(
        i, lambda t, w, f: [np.concatenate(x) for x in ((t - (t[-1] - t[0]) - 0.015, t), (9 * w, w), (0.1 * f, f))]
    ),
    "a track twice": lambda i: (
        i | {"detections": (*i["detections"], *(replace(d, id=900 + d.id, score=0.1) for d in i["detections"][:1]))}
    ),
    "no detections": lambda i: i | {"detections": ()},
}


def disturbed_run(run, items, right, rng, *, share=0.5, most_calls=4000):
    """Feed frames, each with some disturbed calls before it; yields (what, problem or None) of each call."""
    for item, expected in zip(items, right, strict=True):
        state = None
        while state is None and rng.random() < share:
            if rng.random() < 0.3:
                fault = FaultInside(int(np.exp(rng.uniform(0, np.log(most_calls)))))
                what, (state, problem) = f"a fault after {fault.left} calls", _with_fault(run, item, fault)
            else:
                beyond_doubt = set(REFUSED) - ({"samples too late"} if item is items[0] else set())  # all are old there
                what = str(rng.choice(sorted(beyond_doubt)))
                state, problem = _sent(run, REFUSED[what](item))
                problem = "was not refused" if state is not None else problem
            yield what, problem
        what = "right"
        if state is None and rng.random() < 0.2 and len(item["imu"].times_s) > 4:
            what = str(rng.choice(sorted(set(BRIDGED) - {"no detections"})))  # which tells less than the truth
            item = BRIDGED[what](item)
        if state is None:
            state, problem = _sent(run, item)
            if problem:
                yield what, problem
                return
        off_m = float(np.linalg.norm(state.world_from_camera.translation - expected))
        yield what, None if off_m < 0.05 else f"{off_m:.3f} m off"


def _sent(run, item):
    """The state, if the frame was taken in, and what is wrong with what was raised."""
    try:
        return run.process(**item), None
    except MeshslamError as error:
        return None, None if len(str(error)) <= 400 else f"says too much: {error}"
    except Exception as error:  # what the law forbids
        return None, f"{type(error).__name__}: {error}"


def _with_fault(run, item, fault):
    try:
        with fault:
            return run.process(**item), None
    except (MeshslamError, InjectedError):  # as it is where it hits before the work begins
        return None, None
    except Exception as error:
        return None, f"{type(error).__name__}: {error}"
