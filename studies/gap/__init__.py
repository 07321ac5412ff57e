"""The sim-to-real gap of a controller: in the simulator, on a rig that differs, and after a diagnosis."""
