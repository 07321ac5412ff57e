"""Writes models_xml/dampers/NAME.xml, a damper to be included in a model, of every published set.

`python tools/damper_includes.py`
"""

from __future__ import annotations

import sys
from pathlib import Path
from xml.sax.saxutils import escape

from mrdamp import sets
from mrdamp.model import core

FOLDER = Path(__file__).resolve().parents[1] / "models_xml" / "dampers"


def include(id: str) -> str:
    """The file of a set: an instance of its name. Raises InputError for an unknown set."""
    found = sets.load(id)
    unit, low, high = found.command.unit, found.command.min, found.command.max
    config = {"law": found.law, **{key: repr(float(value)) for key, value in found.attributes().items()}}
    order = ["law", *core.attribute_index()]
    rows = "\n".join(
        f'        <config key="{key}" value="{config[key]}"/>' for key in sorted(config, key=order.index)
    )
    about = escape(f"{found.device}. {found.sources[0]}. Command {low:g} to {high:g} {unit}.").replace(
        "--", "-"
    )
    return f"""<!-- {about} Made from the set of this name by tools/damper_includes.py. -->
<mujoco>
  <extension>
    <plugin plugin="mrdamp.damper">
      <instance name="{id}">
{rows}
      </instance>
    </plugin>
  </extension>
</mujoco>
"""


def main() -> int:
    FOLDER.mkdir(exist_ok=True)
    for id in sets.names():
        (FOLDER / f"{id}.xml").write_text(include(id), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
