"""Blind test of the diagnosis: an independent reference rig makes cases whose causes are sealed.

The rig (`rig.c`, with another integrator and other exact forms of each effect), its sensors and its
excitations represent a laboratory. Nothing here uses the plugin's code, and `mrdamp.diagnosis` imports
nothing from here.
"""
