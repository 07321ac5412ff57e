"""A sealed check of the diagnosis: a reference rig written apart from the plugin makes cases whose causes are withheld.

The rig (`rig.c`, another integrator, other exact forms of each effect), its sensors and its excitations stand in for
a laboratory. Nothing here uses the plugin's code, and nothing of it is imported by `mrdamp.diagnosis`.
"""
