"""Simulation of dampers and structures, in MuJoCo and on the C++ chain."""
