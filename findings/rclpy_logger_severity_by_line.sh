#!/usr/bin/env bash
# rclpy 7.1.6 (wheel ros-jazzy-rclpy): a logger remembers the severity of each line of source it is called from. A line that
# chooses the severity by a condition works until the condition changes: then the call raises ValueError, and the node ends.
# Nothing is wrong with the message, the logger or the severities; the same two calls on two lines work.
#
# Seen:   answer 1 logged; answer 2: ValueError: Logger severity cannot be changed between calls.; two lines: no error
# Expect: both are logged. Exit code 0 while the behaviour is as seen, 1 once it changed, 2 if it could not be tried.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" || exit 2
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check 'ros-jazzy-rclpy[fastrtps]==7.1.6' 'numpy<3' || exit 2
cat > "$folder/try.py" <<'PYTHON'
import rclpy
from rclpy.logging import get_logger

log = get_logger("node")


def answer(done, text):
    (log.info if done else log.error)(text)


answer(True, "saved")
print("answer 1 logged")
try:
    answer(False, "nothing to save")
    print("answer 2 logged")
    raise SystemExit(1)
except ValueError as error:
    print(f"answer 2: ValueError: {error}")
    assert "severity cannot be changed" in str(error)
for done in (True, False):
    if done:
        log.info("saved")
    else:
        log.error("nothing to save")
print("two lines: no error")
PYTHON
ROS_LOG_DIR="$folder/log" "$folder/venv/bin/python" "$folder/try.py"
