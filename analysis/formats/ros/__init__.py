"""What ROS bags and MCAP files hold: channels, messages, orientations."""
