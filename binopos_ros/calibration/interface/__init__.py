"""The second step: the surface or the ports that the cameras look through."""
