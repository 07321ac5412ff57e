"""A force law from measured records, evaluated in free run on held-out records.

python examples/02_identify_from_records.py [FOLDER]   (default: the records that come with the package)
"""

import sys

from mrdamp.identify import Fit, identify
from mrdamp.records import embedded, read_records
from mrdamp.simulation.mjcf import write_mjcf


def main(
    folder: str | None = None, law: str = "bouc_wen", most: int = 100, out: str | None = "out/example_02"
) -> Fit:
    """Fits `law` to at most so many records; writes the model and its MJCF into `out`."""
    records = read_records(folder) if folder else embedded()
    # An offset of the force and the driver's lag are fitted along: real records have both.
    fit = identify(
        law, records.train[:most], records.validation[:most], extras=("offset", "driver_lag"), starts=2
    )
    print(f"{law}: error {fit.train_nrmse:.3f} of the force's standard deviation on what it was fitted to")
    for error in fit.held_out:
        print(f"  held out: {error.record:40s} {error.rmse:7.1f} N  {error.nrmse:.3f}")
    for name, value in fit.model.attributes.items():
        print(f"  {name:20s} {value:.6g}")
    if out:
        scene = write_mjcf(fit.model, out)  # with model.json in the same folder
        print(f"look at it: mrdamp view {scene}")
    return fit


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
