"""Cameras, their mutual pose and the interfaces before them, each with its uncertainty.

Three steps: `cameras` (`calibrate_stereo` takes what both cameras see of a board in air),
`interface` (`calibrate_interface` what they see through the surface or the ports), `check` (what
they see every day). They share what is seen (`views`), the `adjustment` and what is left behind
(`report`); `live` takes views from cameras that run.
"""
