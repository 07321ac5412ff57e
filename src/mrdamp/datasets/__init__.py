"""Public measured records of MR dampers: what there is, read from a folder, fetched from their source.

None of them is part of the package. They lie in the folder of the environment variable MRDAMP_DATA, one folder a
set with `train/` and `validation/`, files as in `mrdamp.records.channels.CHANNELS`.
"""

from mrdamp.datasets.catalogue import CATALOGUE, Dataset, Source, data_folder, fetch, found, read

__all__ = ["CATALOGUE", "Dataset", "Source", "data_folder", "fetch", "found", "read"]
