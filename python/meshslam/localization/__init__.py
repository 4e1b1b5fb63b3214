"""Inertial odometry, object factors, localization in a map, joint SLAM."""
