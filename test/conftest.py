"""Every test run has its own ROS domain, on this machine only, with rclpy's field checks on."""

import os

DOMAINS = 100

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % DOMAINS)
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
