"""What the gap of a measured frame costs a controller: in the simulator, and in the corrected one."""
