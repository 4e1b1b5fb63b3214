"""Key points by the shipped network, drawn: over every car of a recording that is wide enough, or over drawn cars.

    .venv/bin/python scripts/keypoint_sheet.py --out sheet.png                          held-out drawn cars
    .venv/bin/python scripts/keypoint_sheet.py --fleet --out sheet.png                  vans, trucks, buses
    .venv/bin/python scripts/keypoint_sheet.py SEQUENCE detections.json --out sheet.png

Green: points of the front, red: of the rear; the number is the viewing angle, 0 ahead of the car, 90 at its left.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from meshslam.perception import KeypointConfig, KeypointFinder, read_detections
from meshslam.perception.keypoints.crop import HEIGHT_PX, WIDTH_PX, Crop
from meshslam.perception.keypoints.decode import peak_angle
from meshslam.sequences import open_sequence

ZOOM, LEAST_SCORE = 2, 0.3
LETTERS = ("lf", "lb", "rf", "rb", "wl", "wr", "bl", "br", "Lf", "Rf", "Lb", "Rb")  # in the order of the key points


def tile(image, crop, mask, pixels, scores, shares, label):
    picture = cv2.resize(crop.cut(image, 114), None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC)
    picture = np.repeat(picture[..., None], 3, 2) if picture.ndim == 2 else picture
    shown = cv2.resize(crop.cut(mask * 255, 0), None, fx=ZOOM, fy=ZOOM)
    border, _ = cv2.findContours((shown > 127).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, border, -1, (0, 200, 200), 1)
    for k, (x, y) in enumerate((crop.to_input(pixels) + 0.5) * ZOOM - 0.5):
        if scores[k] >= LEAST_SCORE:
            colour = (60, 60, 255) if k in (1, 3, 6, 7, 10, 11) else (90, 255, 90)  # rear red, front green
            cv2.circle(picture, (round(x), round(y)), 3, colour, -1)
            cv2.putText(picture, LETTERS[k], (round(x) + 3, round(y) - 3), 0, 0.35, (255, 255, 255), 1)
    angle = float(peak_angle(shares[None])[0])
    cv2.putText(picture, f"{label} {np.degrees(angle):.0f} {shares.max():.2f}", (3, 12), 0, 0.4, (0, 255, 255), 1)
    return picture


def sheet(tiles, columns):
    tiles = tiles + [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    return np.concatenate([np.concatenate(tiles[i : i + columns], 1) for i in range(0, len(tiles), columns)])


def of_recording(sequence, detections, least_px, every, plain):
    recording = open_sequence(sequence)
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}
    tiles = []
    for d in read_detections(detections).detections:
        if d.keypoints is None or max(d.bbox[2:]) < least_px or d.frame % every:
            continue
        mask = d.mask()
        crop = Crop.around(tuple(map(float, cv2.boundingRect(mask))))
        image = recording.read_image(index[d.frame])
        image = np.full_like(image, 70) if plain else image
        label = f"f{d.frame} t{d.track_id}"
        tiles.append(tile(image, crop, mask, d.keypoints, d.keypoint_scores, d.viewing_angle_shares, label))
    return tiles


def of_drawn_cars(count, model, *, fleet):
    from meshslam.simulation import make_cars, make_fleet
    from meshslam.training.pictures import draw_samples

    samples = draw_samples(987_654_321, count, make_fleet if fleet else make_cars)
    finder = KeypointFinder(KeypointConfig(model=model))
    whole, tiles = Crop(0, 0, WIDTH_PX, HEIGHT_PX), []
    for cut, angle in zip(samples.cuts, samples.angles_rad, strict=True):
        image, mask = np.ascontiguousarray(cut[..., :3]), (cut[..., 3] > 127).astype(np.uint8)
        (car,) = finder.find(image, [mask])
        label = f"{np.degrees(angle):.0f}:"
        tiles.append(tile(image, whole, mask, car.pixels, car.scores, car.angle_shares, label))
    return tiles


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", nargs="?", type=Path)
    parser.add_argument("detections", nargs="?", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--least-px", type=float, default=60, help="longer side of the boxes that are drawn")
    parser.add_argument("--every", type=int, default=1, help="take every so many frames")
    parser.add_argument("--plain", action="store_true", help="outlines and points, without the pictures")
    parser.add_argument("--columns", type=int, default=7)
    parser.add_argument("--fleet", action="store_true", help="vans, trucks and buses, drawn")
    parser.add_argument("--model", help="an ONNX file instead of the shipped network, for drawn vehicles")
    parser.add_argument("--count", type=int, default=42, help="of drawn cars")
    a = parser.parse_args()
    if a.sequence:
        tiles = of_recording(a.sequence, a.detections, a.least_px, a.every, a.plain)
    else:
        tiles = of_drawn_cars(a.count, a.model, fleet=a.fleet)
    cv2.imwrite(str(a.out), sheet(tiles, a.columns))
    print(f"{a.out}: {len(tiles)} cars")


if __name__ == "__main__":
    main()
