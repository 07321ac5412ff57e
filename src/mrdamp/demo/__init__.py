"""The main job of `mrdamp demo` (`run`), and its frame in motion (`animation`)."""

from __future__ import annotations

from mrdamp.demo.run import UNCONTROLLED, DemoResult, accelerated, demo

__all__ = ["UNCONTROLLED", "DemoResult", "accelerated", "demo"]
