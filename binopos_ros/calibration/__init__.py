"""Cameras, their mutual pose and the interfaces before them, each with its uncertainty.

`calibrate_stereo` takes what both cameras see of a board in air, `calibrate_interface` what they
see through the surface or the ports, `check` what they see every day.
"""
