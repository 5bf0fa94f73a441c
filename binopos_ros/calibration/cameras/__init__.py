"""The first step, in air: each camera, and the two against each other."""
