"""The ROS shell: one node per stage; parameters, topics and diagnostics, no mathematics."""
