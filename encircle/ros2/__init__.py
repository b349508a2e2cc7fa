"""A running hunt on the keys of ROS 2's Zenoh middleware, and ROS 2 nodes as hunters."""
