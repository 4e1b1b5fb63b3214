"""Names of key points that other tools give, and ours for them."""

APOLLO_24 = (
    *("front_up_right", "front_up_left", "front_light_right", "front_light_left", "front_low_right"),
    *("front_low_left", "central_up_left", "front_wheel_left", "rear_wheel_left", "rear_corner_left"),
    *("rear_up_left", "rear_up_right", "rear_light_left", "rear_light_right", "rear_low_left", "rear_low_right"),
    *("central_up_right", "rear_corner_right", "rear_wheel_right", "front_wheel_right", "rear_plate_left"),
    *("rear_plate_right", "mirror_edge_left", "mirror_edge_right"),
)
APOLLO_FROM_OURS = {
    "left_front_wheel": "front_wheel_left",
    "left_back_wheel": "rear_wheel_left",
    "right_front_wheel": "front_wheel_right",
    "right_back_wheel": "rear_wheel_right",
    "upper_left_windshield": "front_up_left",
    "upper_right_windshield": "front_up_right",
    "upper_left_rearwindow": "rear_up_left",
    "upper_right_rearwindow": "rear_up_right",
    "left_front_light": "front_light_left",
    "right_front_light": "front_light_right",
    "left_back_trunk": "rear_light_left",
    "right_back_trunk": "rear_light_right",
}
_OURS = {apollo: ours for ours, apollo in APOLLO_FROM_OURS.items()}


def ours(name: str) -> str:
    """Our name of a key point of ApolloCar3D; any other name as it is."""
    return _OURS.get(name, name)
