"""Simulation of dampers and structures, in MuJoCo and on the C++ chain.

| module | what |
|---|---|
| `mjcf` | a model as MJCF |
| `stepping` | the written MJCF run over a record or a ground motion |
| `predict` | a model's free run over a record, on the chain |
| `rows` | many copies of one structure on the chain |
| `criteria` | what a structure and its occupants went through |
| `roads` | profiles under a wheel |
"""
