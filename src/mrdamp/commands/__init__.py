"""Commands of `mrdamp`, a module each with `add_to(commands)`."""
