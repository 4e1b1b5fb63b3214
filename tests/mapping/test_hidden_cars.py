"""Cars that others hide: judged when it is known what hides them, whole beyond the part of the image that is kept."""

from dataclasses import replace

import numpy as np

from meshslam.geometry import Pose
from meshslam.mapping import MappingConfig, map_objects
from meshslam.maps import CameraPath
from meshslam.objects import ObjectConfig, category_model
from meshslam.objects.observations import crop_around, make_view
from meshslam.perception import encode_mask

FRAMES = 10


def behind_another(car, car_detection, drive, shown):
    """A car half behind another, which is detected in some frames only: poses, detections, both places."""
    poses = drive(FRAMES, 0.6)
    near, far = (Pose.from_yaw(0.0, np.array([x, y, car.dimensions[2] / 2])) for x, y in ((14.0, 3.2), (19.5, 4.6)))
    found = []
    for i in range(FRAMES):
        hider = (near, car.vertices)
        found.append(car_detection(len(found) + 1, i, poses[i], far, car.vertices, hidden_by=[hider], track=2))
        if i in shown:
            found.append(car_detection(len(found) + 1, i, poses[i], near, car.vertices, track=1))
    return poses, found, {1: near, 2: far}


def test_a_car_is_judged_when_the_place_of_what_hides_it_is_known(camera, car, car_detection, as_set, drive):
    """Without the neighbour in half of the frames its masks do not fit: at the mesh's first fit their IoU is 0.41."""
    poses, found, places = behind_another(car, car_detection, drive, range(5))
    frames = CameraPath(camera, tuple(range(FRAMES)), np.arange(FRAMES) * 0.1, poses, 1.65)
    mapped = map_objects(frames, as_set(FRAMES, found), car, ObjectConfig(), MappingConfig(), fixed_tracks=True)
    assert mapped.left_out == ()
    assert {thing.id for thing in mapped.map.objects} == {1, 2}
    for thing in mapped.map.objects:
        assert np.linalg.norm(thing.world_from_object.translation - places[thing.id].translation) < 0.1
        assert thing.mask_iou > 0.85


def test_what_another_car_hides_beyond_the_crop_is_hidden(camera, car, car_detection, drive):
    """Of a car seen by its last metre the crop ends before the car does; the true mesh fits its mask."""
    pose = drive(1)[0]
    place = Pose.from_yaw(np.pi / 2, np.array([13.0, 1.0, car.dimensions[2] / 2]))
    wall = np.zeros((camera.height, camera.width), np.uint8)
    wall[:, 250:] = 1
    whole = car_detection(1, 0, pose, place, car.vertices)
    mask = whole.mask() * (1 - wall)
    rows, columns = np.nonzero(mask)
    box = tuple(map(float, (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)))
    seen = replace(whole, bbox=box, segmentation=encode_mask(mask), keypoints=None, keypoint_scores=None)
    model, config = category_model(car), ObjectConfig()
    crop = crop_around(seen, camera, config.crop_margin)
    corners = camera.project((pose.inverse() @ place).transform(car.vertices))
    assert corners[:, 0].max() > crop.x0 + crop.width + 50  # some of the car lies beyond
    view = make_view(model, camera, pose, 0.0, seen, wall, [], config)
    [[iou]] = model.mask_ious([view], [place], car.vertices)
    assert iou > 0.95
    state = model.state_at(place)
    found = model.refine([view], None, config.noise, state, modes=False, free_form=False)
    assert np.linalg.norm(found.state.world_from_object.translation - place.translation) < 0.1
