"""Former names of `mrdamp.upsampling`, for `mrdamp.diagnosis`."""

from mrdamp.upsampling import FineInputs as Fine
from mrdamp.upsampling import repaired_ends as mended_ends
from mrdamp.upsampling import upsampled as between

__all__ = ["Fine", "between", "mended_ends"]
