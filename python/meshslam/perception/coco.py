"""The 80 class names of the COCO data set (Lin et al. 2014), in the order in which networks number them."""

_NAMES = """
person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign,
parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella, handbag,
tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, skateboard, surfboard,
tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot,
hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote,
keyboard, cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush
"""

COCO_CLASSES = tuple(" ".join(name.split()) for name in _NAMES.split(","))

VEHICLES = frozenset({"car", "truck", "bus"})  # networks flip between these on one and the same vehicle
VEHICLE_GROUP = "vehicle"


def association_group(category: str) -> str:
    """Name what a category is compared with: vehicles with each other, everything else with its like."""
    return VEHICLE_GROUP if category in VEHICLES else category


_LEFT_OUT = (12, 26, 29, 30, 45, 66, 68, 69, 71, 83)  # of the 90 numbers that annotation files use
COCO_NUMBERS = dict(zip((n for n in range(1, 91) if n not in _LEFT_OUT), COCO_CLASSES, strict=True))
