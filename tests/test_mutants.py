"""The mutants of the physics are mutants of what the sources say; `python tools/mutants.py` runs them."""

from __future__ import annotations

from modules import ROOT, TOOLS, loaded

tool = loaded(TOOLS / "mutants.py")


def test_every_mutant_changes_one_place_of_its_file() -> None:
    texts: dict[str, str] = {}
    for number, mutant in enumerate(tool.MUTANTS, start=1):
        text = texts.setdefault(mutant.file, (ROOT / mutant.file).read_text())
        changed = mutant.applied(text, number)  # ValueError where it does not stand there once
        assert changed != text
        texts[mutant.file] = changed if mutant.cpp else text
        assert all((ROOT / file).is_file() for file in mutant.tests), mutant.name
