"""ROS 1 bags, ROS 2 bags and MCAP files as sequences: stores of messages, one index of them, images read on demand."""
