"""Object-level SLAM with instance-specific meshes."""
